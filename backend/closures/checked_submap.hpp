// Two submaps made ready for being compared, and registered to one another.
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

/// What the rest of the graph says of the pose to be measured.
struct PoseBound {
  Pose from_from_to;           ///< As the graph has it.
  double translation_m = 1e9;  ///< The truth is believed to be within this of it,
  double rotation_rad = M_PI;  ///< and this.
};

/// A submap made ready for checking.
struct CheckedSubmap {
  CheckedSubmap(Submap submap, const GroundAlignment& ground_alignment);

  std::int64_t id = 0;
  GroundAlignment ground;
  std::vector<Eigen::Vector3d> path;    ///< Sensor positions [m], submap frame, the keypose first.
  std::vector<Eigen::Vector3f> points;  ///< [m], submap frame.
  VoxelCloud cloud;

  /// What others are registered to, by 2 m voxels or finely: made when it is first asked for. Not for two
  /// threads at once, and no more is register_fine() with the same submap.
  LocalMap& coarse_map() const;
  LocalMap& fine_map() const;
  void drop_maps() const;

 private:
  mutable std::optional<LocalMap> coarse_map_, fine_map_;
};

/// Voxels of a submap's cloud to go on by so that about `sample` of them are looked at; at least 1.
int stride_for(const CheckedSubmap& submap, std::size_t sample);

/// Registers `to` to `from`, reaching as far as 2 m voxels do. @return from_from_to; it may not be finite
Pose register_coarse(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess);
/// The same from a guess that is good to about a metre, to centimetres.
Pose register_fine(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess);
/// The same for some of a submap's points.
Pose register_fine(const CheckedSubmap& from, const std::vector<Eigen::Vector3f>& points, const Pose& guess);

}  // namespace hp2
