// How much of two clouds is the same surface, where both could have seen it.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <tsl/robin_map.h>
#include <tsl/robin_set.h>

#include "common/geometry/pose.hpp"
#include "common/registration/voxel_key.hpp"

namespace hp2 {

/// A cloud in voxels of 0.5 m (one point each) and columns of 2 m, for look-ups.
class VoxelCloud {
 public:
  /// @param points  [m]; not finite ones are left out
  /// @param normals unit or zero, one per point; may be empty
  /// @param ground_from_points tells what stands above the ground
  VoxelCloud(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals,
             const Pose& ground_from_points);

  struct Voxel {
    Eigen::Vector3f point, normal;
    bool structure = false;  ///< More than 0.4 m above the ground.
  };
  const std::vector<Voxel>& voxels() const { return voxels_; }
  std::size_t column_count() const { return columns_.size(); }
  /// True if anything was seen in the column over `p`.
  bool seen(const Eigen::Vector3f& p) const;
  /// Nearest voxel point among the 8 voxels around `p`; null beyond `max_distance_m` (at most 0.5 m is
  /// sensible).
  const Voxel* nearest(const Eigen::Vector3f& p, float max_distance_m) const;
  /// True if there is one: the first that is found will do.
  bool any_near(const Eigen::Vector3f& p, float max_distance_m) const;

 private:
  template <bool any>
  const Voxel* search(const Eigen::Vector3f& p, float max_distance_m) const;
  /// 4 x 4 x 4 voxels: their numbers, -1 for an empty one. A query's eight voxels mostly lie in one or two.
  using Block = std::array<std::int32_t, 64>;

  std::int32_t find_block(const Eigen::Vector3i& block) const;  // -1: none
  std::vector<Voxel> voxels_;
  std::vector<Block> blocks_;
  tsl::robin_map<std::uint64_t, std::int32_t, VoxelKeyHash> index_;
  tsl::robin_set<std::uint64_t, VoxelKeyHash> columns_;
};

/// Agreement of a cloud with another.
struct Overlap {
  int common = 0;          ///< Voxels of the cloud in columns that the other one has seen as well.
  int structure = 0;       ///< Of these above the ground.
  double share = 0.0;      ///< Of the common structure, what the other has there too, 0..1.
  double all_share = 0.0;  ///< The same of all common voxels, ground included.
};

/// @param stride looks at every stride-th voxel only
/// @param max_distance_m how near the other's surface counts as the same
Overlap overlap_of(const VoxelCloud& cloud, const VoxelCloud& other, const Pose& other_from_cloud,
                   int stride = 1, float max_distance_m = 0.4F);

}  // namespace hp2
