// Queries of the local map for every correspondence: the nearest point, and the moments around it.
#include <algorithm>
#include <cmath>
#include <limits>

#include "common/registration/local_map.hpp"
#include "common/registration/local_map_blocks.hpp"
#include "common/registration/simd.hpp"

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

LocalMap::Probe LocalMap::probe(const VoxelPoint& at, Cursor& cursor) const {
  Probe p;
  p.at = at;
  p.block = find_block(block_of(at.voxel), cursor);
  if (p.block >= 0) {
    const Block& block = blocks_[static_cast<std::size_t>(p.block)];
    __builtin_prefetch(&block.neighbours);
    __builtin_prefetch(&block.cells[static_cast<std::size_t>(cell_of(at.voxel))]);
  }
  return p;
}

// The query's own voxel and the seven others at that corner of it that is next to the query.
void LocalMap::look_around(Probe& p) const {
  p.count = 0;
  if (p.block < 0) return;
  const Block& block = blocks_[static_cast<std::size_t>(p.block)];
  const int octant = (p.at.offset.x() < half_ ? 0 : 1) | (p.at.offset.y() < half_ ? 0 : 2) |
                     (p.at.offset.z() < half_ ? 0 : 4);
  const auto& steps = tables().octants[static_cast<std::size_t>(cell_of(p.at.voxel) * 8 + octant)];
  for (int k = 0; k < 8; ++k) {
    const Step step = steps[static_cast<std::size_t>(k)];
    const std::int32_t b = block.neighbours[step.block];
    if (b < 0) continue;
    const std::int32_t v = blocks_[static_cast<std::size_t>(b)].cells[step.cell];
    const auto n = static_cast<std::size_t>(p.count);
    p.voxels[n] = v;
    p.corners[n] = static_cast<std::uint8_t>(k);
    p.count += v >= 0 ? 1 : 0;
    if (v >= 0) prefetch_line(v);
  }
}

// First the eight voxels at the query's corner. They hold every point up to their nearest outer face, which
// is at least half a voxel away; their points are compared without a branch. If a nearer point may lie
// beyond, all 27 are searched.
NearestPoint LocalMap::nearest(const Probe& query, float margin_m) const {
  if (query.count == 0 || lines_per_voxel_ > 1) return nearest_of_27(query, margin_m);
  const auto edge = static_cast<float>(voxel_size_);
  const Eigen::Vector3f& offset = query.at.offset;
  const Eigen::Vector3f to_face = offset.cwiseMax(Eigen::Vector3f::Constant(edge) - offset);
  const float border = to_face.minCoeff(), border2 = border * border;
  Eigen::Vector3f shift;  // of the neighbour along each axis
  for (int a = 0; a < 3; ++a) shift[a] = offset[a] < half_ ? -edge : edge;

  constexpr float kFar = std::numeric_limits<float>::max();
  Float4 best4 = {kFar, kFar, kFar, kFar}, other4 = best4;
  Int4 best4_at = {0, 0, 0, 0};
  float best1 = kFar, other1 = kFar;  // of the fifth slot
  int best1_at = 0;
  for (std::int32_t k = 0; k < query.count; ++k) {
    const auto n = static_cast<std::size_t>(k);
    const int corner = query.corners[n];
    const Line& line = lines_[static_cast<std::size_t>(query.voxels[n])];
    const float x = offset.x() - ((corner & 1) != 0 ? shift.x() : 0.0F);
    const float y = offset.y() - ((corner & 2) != 0 ? shift.y() : 0.0F);
    const float z = offset.z() - ((corner & 4) != 0 ? shift.z() : 0.0F);
    const Float4 dx = load4(line.xyz[0]) - x, dy = load4(line.xyz[1]) - y, dz = load4(line.xyz[2]) - z;
    const Float4 d2 = dx * dx + dy * dy + dz * dz;
    const Int4 nearer = d2 < best4;
    other4 = min4(other4, nearer ? best4 : d2);
    best4_at = nearer ? Int4{k, k, k, k} : best4_at;
    best4 = nearer ? d2 : best4;
    const float ex = line.xyz[0][4] - x, ey = line.xyz[1][4] - y, ez = line.xyz[2][4] - z;
    const float e2 = ex * ex + ey * ey + ez * ez;
    const bool nearer1 = e2 < best1;
    other1 = std::min(other1, nearer1 ? best1 : e2);
    best1_at = nearer1 ? k : best1_at;
    best1 = nearer1 ? e2 : best1;
  }
  float best2 = best1, other2 = other1;
  int slot = 4, at = best1_at;
  for (int s = 0; s < 4; ++s) {
    const bool nearer = best4[s] < best2;
    other2 = std::min(std::min(other2, other4[s]), nearer ? best2 : best4[s]);
    slot = nearer ? s : slot;
    at = nearer ? best4_at[s] : at;
    best2 = nearer ? best4[s] : best2;
  }
  if (!(best2 < border2)) return nearest_of_27(query, margin_m);
  NearestPoint nearest;
  const auto n = static_cast<std::size_t>(at);
  nearest.voxel = query.voxels[n];
  nearest.slot = slot;
  nearest.offset = lines_[static_cast<std::size_t>(nearest.voxel)].point(slot);
  for (int a = 0; a < 3; ++a) nearest.offset[a] += (query.corners[n] >> a & 1) != 0 ? shift[a] : 0.0F;
  nearest.distance_m = std::sqrt(best2);
  nearest.other_distance_m = std::min(std::sqrt(other2), border);
  return nearest;
}

NearestPoint LocalMap::nearest_of_27(const Probe& query, float margin_m) const {
  const VoxelPoint& q = query.at;
  const auto edge = static_cast<float>(voxel_size_);
  const Voxel3i centre_block = block_of(q.voxel);
  const std::int32_t centre = query.block;
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
  // No point outside the 27 voxels is nearer than their common border.
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
        bool nearer = false;
        for (std::int32_t first = 0, count = line->count; first < count; first += kPointsPerLine, ++line) {
          float d2[kPointsPerLine];
          line->distances2(from_corner, d2);
          float least = d2[0];
          for (std::int32_t s = 1; s < kPointsPerLine; ++s) least = std::min(least, d2[s]);
          if (least >= best2) {
            other2 = std::min(other2, least);
            continue;
          }
          if (best.voxel >= 0) other2 = std::min(other2, best2);
          std::int32_t slot = 0;
          while (d2[slot] != least) ++slot;
          for (std::int32_t s = 0; s < kPointsPerLine; ++s) {
            if (s != slot) other2 = std::min(other2, d2[s]);
          }
          best2 = least;
          best.voxel = v;
          best.slot = first + slot;
          best.offset = shift + line->point(slot);
          nearer = true;
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

Planarity LocalMap::shape(std::int32_t index) const {
  constexpr float kEnough = 5.0F;
  const Planarity narrow = analyse(neighbourhood_moments(index));
  if (!wide_ || (narrow.n >= kEnough && narrow.line == Eigen::Vector3f::Zero())) return narrow;
  const Planarity wide = analyse(neighbourhood_moments(index, true));
  return wide.n >= kEnough && wide.line == Eigen::Vector3f::Zero() ? wide : narrow;
}

Moments LocalMap::neighbourhood_moments(std::int32_t index, bool wide) const {
  // Sums of a block's voxels are about its centre, and the few blocks' sums are moved to the voxel's corner.
  const Voxel& voxel = voxels_[static_cast<std::size_t>(index)];
  const Block& own = blocks_[static_cast<std::size_t>(voxel.block)];
  const Reach& reach = wide ? tables().wide_reach[voxel.cell] : tables().reach[voxel.cell];
  const Eigen::Vector3d corner = voxel.coordinates.cast<double>() * voxel_size_;
  Moments sum;
  for (int k = 0; k < reach.blocks; ++k) {
    const auto number = static_cast<std::size_t>(k);
    const std::int32_t b = own.neighbours[reach.block[number]];
    if (b < 0) continue;
    const Block& block = blocks_[static_cast<std::size_t>(b)];
    std::uint64_t cells = reach.cells[number] & block.occupied;
    if (cells == 0) continue;
    VoxelMoments total;
    for (; cells != 0; cells &= cells - 1) {
      const auto cell = static_cast<std::size_t>(__builtin_ctzll(cells));
      const VoxelMoments& m = moments_[static_cast<std::size_t>(block.cells[cell])];
      for (int i = 0; i < 10; ++i) total.v[i] += m.v[i];
    }
    Moments part;
    part.n = total.v[0];
    part.sum = Eigen::Map<const Eigen::Vector3d>(total.v + 1);
    part.products = Eigen::Map<const Eigen::Matrix<double, 6, 1>>(total.v + 4);
    sum.add_shifted(part, block_centre(block.coordinates) - corner);
  }
  return sum;
}

}  // namespace hp2
