// What the back-end believes of the odometry's errors: a scan's own covariance, never less than a floor that
// grows with the motion. Shared by the pose graph and the scan-level refinement, so that both weigh alike.
#pragma once
#include <vector>

#include "common/submap.hpp"

namespace hp2 {

/// Motion between consecutive scans of a submap and its covariance.
struct OdometryStep {
  Pose previous_from_current;
  Matrix6d covariance;  ///< Right increments (rho [m], phi [rad]) in the current scan's sensor frame.
  double length_m = 0.0;
};

/// The steps of a submap in order of time, the first one from the keypose. One a scan.
std::vector<OdometryStep> odometry_steps(const std::vector<ScanPose>& scans);

/// Covariance of the last scan's pose in the submap: right increments in that scan's frame (first order).
Matrix6d accumulated_covariance(const std::vector<OdometryStep>& steps);

}  // namespace hp2
