// Pieces of planes that several scans of a window have seen.
#pragma once
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace hp2 {

/// A point in the window's frame, with where it came from.
struct PatchPoint {
  Eigen::Vector3d position;  ///< [m]
  std::uint32_t index = 0;   ///< Whatever the caller tells it by.
  std::uint16_t scan = 0;
};

/// When points form a patch.
struct PatchConfig {
  double largest_edge_m = 2.0;   ///< Cubes of this edge that hold no plane are halved,
  double smallest_edge_m = 0.5;  ///< down to this edge.
  std::size_t fewest_points = 25;
  std::size_t fewest_scans = 4;
  double thickness = 0.05;   ///< Largest l3 / l2 of a patch.
  double thickest_m = 1e3;   ///< Largest square root of l3 of the points on the plane.
  double elongation = 0.05;  ///< Smallest l2 / l1.
};

/// A piece of a plane.
struct PlanePatch {
  Eigen::Vector3d centre, normal, along, across;  ///< [m]; unit vectors, the latter two in the plane.
  std::vector<std::uint32_t> members;             ///< Of the points given.
};

/// Finds patches; each point is in one of them at most.
std::vector<PlanePatch> find_patches(const std::vector<PatchPoint>& points, const PatchConfig& config);

}  // namespace hp2
