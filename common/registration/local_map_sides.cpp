// Thin objects have two sides. The map keeps them apart by the directions from which points were seen.
#include <algorithm>
#include <cmath>

#include "common/registration/local_map.hpp"
#include "common/registration/local_map_blocks.hpp"

namespace hp2 {

using namespace map_blocks;

LocalMap::View LocalMap::quantised(const Eigen::Vector3d& to_sensor) {
  const double length = to_sensor.norm();
  if (!(length > 0.0)) return View::Zero();
  constexpr double kFarthest = 127.0;
  Eigen::Vector4d view;
  view << static_cast<double>(kViewUnit) / length * to_sensor, std::clamp(length, 1.0, kFarthest);
  return view.array().round().cast<std::int8_t>();
}

NearestPoint LocalMap::nearest_on_side(const Eigen::Vector3f& query, std::int32_t index,
                                       const Eigen::Vector3f& normal, const Eigen::Vector3f& query_view,
                                       float reach_m) const {
  const Voxel& own = voxels_[static_cast<std::size_t>(index)];
  const Block& block = blocks_[static_cast<std::size_t>(own.block)];
  NearestPoint best;
  float best2 = reach_m * reach_m;
  for (int k = 0; k < 27; ++k) {
    const Voxel3i step = neighbour_offset(k), coordinates = own.coordinates + step;
    const std::int32_t b = block.neighbours[neighbour_number(block_of(coordinates) - block.coordinates)];
    if (b < 0) continue;
    const std::int32_t v =
        blocks_[static_cast<std::size_t>(b)].cells[static_cast<std::size_t>(cell_of(coordinates))];
    if (v < 0) continue;
    const Eigen::Vector3f shift = step.cast<float>() * static_cast<float>(voxel_size_);
    for (std::int32_t s = 0; s < count(v); ++s) {
      const Eigen::Vector3f offset = point_offset(v, s) + shift;
      const float d2 = (offset - query).squaredNorm();
      if (d2 >= best2 || other_side(normal, view(v, s), query_view)) continue;
      best2 = d2;
      best.voxel = v;
      best.slot = s;
      best.offset = offset;
    }
  }
  best.distance_m = std::sqrt(best2);
  return best;
}

void LocalMap::insert_other_side(const Eigen::Vector3d& p, const Eigen::Vector3f& normal,
                                 const Eigen::Vector3d& seen_from) {
  const VoxelPoint at = locate(p);
  const std::int32_t v = voxel_at(at.voxel);
  const Eigen::Vector3d to_sensor = seen_from - p;
  const Eigen::Vector3f now = to_sensor.normalized().cast<float>();
  std::int32_t first_other = -1;
  for (std::int32_t s = 0; s < count(v); ++s) {
    if (other_side(normal, view(v, s), now)) {
      if (first_other < 0) first_other = s;
    } else if ((point_offset(v, s) - at.offset).squaredNorm() < min_spacing2_) {
      return;
    }
  }
  if (static_cast<std::size_t>(count(v)) < capacity_) {
    add_point(v, at.offset, quantised(to_sensor));
  } else if (first_other >= 0) {
    replace_point(v, first_other, at.offset, quantised(to_sensor));
  } else {
    return;
  }
  if (!all_stale_) mark_neighbours_stale(v);
}

}  // namespace hp2
