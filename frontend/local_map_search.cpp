// What is asked of the local map for every correspondence: the nearest point, and the moments around it.
#include <algorithm>
#include <cmath>

#include "frontend/local_map.hpp"
#include "frontend/local_map_blocks.hpp"

namespace hp2 {

using namespace map_blocks;

namespace {

// The three slabs of voxels along one axis, the nearest first.
struct Slabs {
  int step[3];      // -1, 0 or 1
  float bound2[3];  // squared distance from the query [m^2]

  Slabs(float offset, float edge) {
    const float low = offset * offset, high = (edge - offset) * (edge - offset);
    const bool low_first = low <= high;
    step[0] = 0;
    step[1] = low_first ? -1 : 1;
    step[2] = -step[1];
    bound2[0] = 0.0F;
    bound2[1] = low_first ? low : high;
    bound2[2] = low_first ? high : low;
  }
};

}  // namespace

NearestPoint LocalMap::nearest(const VoxelPoint& q, Cursor& cursor, float margin_m) const {
  const auto edge = static_cast<float>(voxel_size_);
  const Voxel3i centre_block = block_of(q.voxel);
  const std::int32_t centre = find_block(centre_block, cursor);
  const Voxel3i in_block(q.voxel.x() & kMask, q.voxel.y() & kMask, q.voxel.z() & kMask);
  // Where there is no block, its neighbours are looked up when they are needed.
  constexpr std::int32_t kUnknown = -2;
  std::array<std::int32_t, 27> looked_up;
  const std::int32_t* links = nullptr;
  if (centre >= 0) {
    links = blocks_[static_cast<std::size_t>(centre)].neighbours.data();
  } else {
    looked_up.fill(kUnknown);
    looked_up[13] = -1;
    links = looked_up.data();
  }

  const Slabs xs(q.offset.x(), edge), ys(q.offset.y(), edge), zs(q.offset.z(), edge);
  NearestPoint best;
  float best2 = std::numeric_limits<float>::infinity();
  // Nothing that is not in the 27 voxels is nearer than their common border.
  const float beyond = edge + std::min(q.offset.minCoeff(), edge - q.offset.maxCoeff());
  const float beyond2 = beyond * beyond;
  float other2 = beyond2;
  float cutoff2 = std::numeric_limits<float>::infinity();
  for (int k = 0; k < 3; ++k) {
    const float bound_z = zs.bound2[k];
    if (bound_z >= cutoff2) {
      other2 = std::min(other2, bound_z);
      break;
    }
    const int z = in_block.z() + zs.step[k];
    for (int j = 0; j < 3; ++j) {
      const float bound_yz = bound_z + ys.bound2[j];
      if (bound_yz >= cutoff2) {
        other2 = std::min(other2, bound_yz);
        break;
      }
      const int y = in_block.y() + ys.step[j];
      const int block_yz = 3 * ((y >> kBits) + 1) + 9 * ((z >> kBits) + 1);
      const int cell_yz = ((y & kMask) << kBits) | ((z & kMask) << (2 * kBits));
      for (int i = 0; i < 3; ++i) {
        const float bound2 = bound_yz + xs.bound2[i];
        if (bound2 >= cutoff2) {
          other2 = std::min(other2, bound2);
          break;
        }
        const int x = in_block.x() + xs.step[i];
        const auto link = static_cast<std::size_t>((x >> kBits) + 1 + block_yz);
        std::int32_t b = links[link];
        if (b == kUnknown) {
          b = looked_up[link] = find_block(centre_block + neighbour_offset(static_cast<int>(link)));
        }
        if (b < 0) continue;
        const std::int32_t v =
            blocks_[static_cast<std::size_t>(b)].cells[static_cast<std::size_t>((x & kMask) | cell_yz)];
        if (v < 0) continue;
        const Eigen::Vector3f shift(static_cast<float>(xs.step[i]) * edge,
                                    static_cast<float>(ys.step[j]) * edge,
                                    static_cast<float>(zs.step[k]) * edge);
        const Eigen::Vector3f from_corner = q.offset - shift;
        const Line* line = &lines_[static_cast<std::size_t>(v) * lines_per_voxel_];
        const std::int32_t count = line->count;
        bool nearer = false;
        for (std::int32_t first = 0; first < count; first += kPointsPerLine, ++line) {
          const std::int32_t n = std::min(count - first, kPointsPerLine);
          for (std::int32_t s = 0; s < n; ++s) {
            const float dx = line->xyz[3 * s] - from_corner.x(), dy = line->xyz[3 * s + 1] - from_corner.y(),
                        dz = line->xyz[3 * s + 2] - from_corner.z();
            const float d2 = dx * dx + dy * dy + dz * dz;
            if (d2 < best2) {
              if (best.voxel >= 0) other2 = std::min(other2, best2);
              best2 = d2;
              best.voxel = v;
              best.slot = first + s;
              best.offset =
                  shift + Eigen::Vector3f(line->xyz[3 * s], line->xyz[3 * s + 1], line->xyz[3 * s + 2]);
              nearer = true;
            } else {
              other2 = std::min(other2, d2);
            }
          }
        }
        if (nearer) {
          const float reach = std::sqrt(best2) + margin_m;
          cutoff2 = std::max(best2, std::min(reach * reach, beyond2));
        }
      }
    }
  }
  best.distance_m = std::sqrt(best2);
  best.other_distance_m = std::sqrt(other2);
  return best;
}

Moments LocalMap::neighbourhood_moments(std::int32_t index) const {
  // Rows along x, rows to layers along y, layers along z: a sum is moved along one axis at a time.
  const Voxel& voxel = voxels_[static_cast<std::size_t>(index)];
  const Block& block = blocks_[static_cast<std::size_t>(voxel.block)];
  const auto& steps = tables().steps[static_cast<std::size_t>(cell_of(voxel.coordinates))];
  Moments sum;
  std::size_t k = 0;
  for (int z = -1; z <= 1; ++z) {
    Moments layer;
    for (int y = -1; y <= 1; ++y) {
      Moments row;
      for (int x = -1; x <= 1; ++x, ++k) {
        const std::int32_t b = block.neighbours[steps[k].block];
        if (b < 0) continue;
        const std::int32_t v = blocks_[static_cast<std::size_t>(b)].cells[steps[k].cell];
        if (v >= 0) row.add_shifted_along<0>(moments_[static_cast<std::size_t>(v)], x * voxel_size_);
      }
      if (row.n > 0.0) layer.add_shifted_along<1>(row, y * voxel_size_);
    }
    if (layer.n > 0.0) sum.add_shifted_along<2>(layer, z * voxel_size_);
  }
  return sum;
}

}  // namespace hp2
