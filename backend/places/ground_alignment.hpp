// Where the ground is in a submap, so that its bird's-eye view does not depend on how the sensor is mounted
// or on the slope of the road.
#pragma once
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// Outcome of align_ground().
struct GroundAlignment {
  /// z up from the ground plane, heading and horizontal origin those of the submap. Identity if no ground was
  /// found.
  Pose ground_from_submap;
  bool found = false;
  double inlier_share = 0.0;  ///< Of the structure near the path, what lies on the plane, 0..1.
};

/// Finds the ground as the plane below the sensor's path, within 45 degrees of the keypose's xy-plane, that
/// explains most of the structure near the path. Where the ground is no plane (hills), the one that fits best
/// near the path.
/// @param points submap points [m]
/// @param path   sensor positions in the submap's frame [m]; empty: the origin
GroundAlignment align_ground(const std::vector<Eigen::Vector3f>& points,
                             const std::vector<Eigen::Vector3d>& path);

}  // namespace hp2
