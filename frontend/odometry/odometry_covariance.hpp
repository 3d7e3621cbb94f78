// Covariance of the motion since the last scan.
#pragma once
#include "common/geometry/pose.hpp"
#include "common/registration/hybrid_icp.hpp"
#include "frontend/odometry/motion_model.hpp"

namespace hp2 {

/// Covariance [m^2, m rad, rad^2] of the motion since the last scan in this scan's sensor frame, as far as it
/// comes from the registration: its information, and the size of its residuals.
/// @param sigma_m scale that the scan was registered with
Matrix6d registration_covariance(const IcpResult& icp, double sigma_m);

/// Standard deviation of the translation along its most uncertain direction [m].
double weakest_deviation_m(const Matrix6d& covariance);

/// Additional covariance from deskewing at constant velocity while the sensor moved unevenly.
Matrix6d deskew_covariance(const Unevenness& uneven);

/// Covariance of a motion that is the prediction alone, over a gap: half of the motion, at least 1 m, and 0.5
/// rad.
Matrix6d guess_covariance(const Pose& motion);

}  // namespace hp2
