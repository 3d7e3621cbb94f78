// Submaps prepared for comparison, and their registration to each other.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "backend/closures/overlap.hpp"
#include "backend/places/ground_alignment.hpp"
#include "common/registration/local_map.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// The graph's estimate of the pose to be measured, with its bound.
struct PoseBound {
  Pose from_from_to;           ///< The graph's estimate.
  double translation_m = 1e9;  ///< The true pose is at most this far from it,
  double rotation_rad = M_PI;  ///< and turned by at most this.
};

/// A submap prepared for checking.
struct CheckedSubmap {
  CheckedSubmap(Submap submap, const GroundAlignment& ground_alignment);

  std::int64_t id = 0;
  GroundAlignment ground;
  std::vector<Eigen::Vector3d> path;    ///< Sensor positions [m], submap frame, the keypose first.
  std::vector<Eigen::Vector3f> points;  ///< [m], submap frame.
  VoxelCloud cloud;

  /// Maps that others are registered to, with 2 m voxels or fine ones; built at the first call. Not safe for
  /// two threads at once, and neither is register_fine() with the same submap.
  LocalMap& coarse_map() const;
  LocalMap& fine_map() const;
  void drop_maps() const;

 private:
  mutable std::optional<LocalMap> coarse_map_, fine_map_;
};

/// Stride through the voxels of a submap's cloud that visits about `sample` of them; at least 1.
int stride_for(const CheckedSubmap& submap, std::size_t sample);

/// Registers `to` to `from`, reaching as far as 2 m voxels do. @return from_from_to; it may not be finite
Pose register_coarse(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess);
/// The same from a guess that is good to about a metre, to centimetres.
Pose register_fine(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess);
/// The same for some of a submap's points.
Pose register_fine(const CheckedSubmap& from, const std::vector<Eigen::Vector3f>& points, const Pose& guess);

}  // namespace hp2
