// The back-end's model of odometry errors: a scan's own covariance plus a floor that grows with the motion.
// Shared by the pose graph and the scan-level refinement, so that both weigh alike.
#pragma once
#include <cstdint>
#include <vector>

#include "common/submap.hpp"

namespace hp2 {

/// Motion between consecutive scans of a submap and its covariance.
struct OdometryStep {
  Pose previous_from_current;
  Matrix6d covariance;  ///< Right increments (rho [m], phi [rad]) in the current scan's sensor frame.
  double length_m = 0.0;
  double duration_s = 0.0;
  bool loss = false;  ///< Tracking was lost: the motion is a guess, and its two sides are two pieces.
  double loss_m = 0.0, loss_rad = 0.0;  ///< Then: standard deviation of the guess.
};

/// The steps of a submap in order of time, the first one from the keypose. One per scan.
/// @param utime_before end of the sweep before the first one [us]; 0: unknown, the scans' own rate is taken
std::vector<OdometryStep> odometry_steps(const std::vector<ScanPose>& scans, std::int64_t utime_before = 0);

/// Covariance of the last scan's pose in the submap: right increments in that scan's frame (first order).
Matrix6d accumulated_covariance(const std::vector<OdometryStep>& steps);

}  // namespace hp2
