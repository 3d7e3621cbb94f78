// What the motion since the last scan is worth.
#pragma once
#include "common/geometry/pose.hpp"
#include "frontend/hybrid_icp.hpp"

namespace hp2 {

/// Covariance [m^2, m rad, rad^2] of the motion since the last scan in this scan's sensor frame, from the
/// scan's information. The robust weights make the sums speak as if a residual's deviation were sigma [m];
/// what it is worth when the correlation between neighbouring points is counted in was found on simulated
/// drives (mean normalised error squared).
Matrix6d motion_covariance(const IcpResult& icp, double sigma_m);

/// The same of a motion that is the prediction alone, over a gap: half of the way, at least 1 m, and 0.5 rad.
Matrix6d guess_covariance(const Pose& motion);

}  // namespace hp2
