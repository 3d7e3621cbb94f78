// How much of two clouds is the same surface, where both could have seen it.
#pragma once
#include <cstdint>
#include <vector>

#include <Eigen/Core>
#include <tsl/robin_map.h>
#include <tsl/robin_set.h>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// A cloud in voxels of 0.5 m (one point each) and columns of 2 m, for look-ups.
class VoxelCloud {
 public:
  /// @param points  [m]; not finite ones are left out
  /// @param normals unit or zero, one a point; may be empty
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
  bool seen(const Eigen::Vector3f& p) const { return columns_.count(column_key(p)) > 0; }
  /// Nearest voxel point among the 8 voxels around `p`; null beyond `max_distance_m` (at most 0.5 m is
  /// sensible).
  const Voxel* nearest(const Eigen::Vector3f& p, float max_distance_m) const;

 private:
  /// The maps take the low bits of a hash as it stands: coordinates packed side by side would nearly all
  /// collide.
  struct Mix {
    std::size_t operator()(std::uint64_t k) const {
      k *= 0x9E3779B97F4A7C15ULL;
      return k ^ (k >> 32);
    }
  };
  static std::uint64_t voxel_key(const Eigen::Vector3i& v);
  static std::uint64_t column_key(const Eigen::Vector3f& p);
  std::vector<Voxel> voxels_;
  tsl::robin_map<std::uint64_t, std::int32_t, Mix> index_;
  tsl::robin_set<std::uint64_t, Mix> columns_;
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
