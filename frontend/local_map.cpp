#include "frontend/local_map.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {
namespace {

constexpr int kBits = 2;  // a block has 2^kBits voxels along each axis
constexpr int kMask = (1 << kBits) - 1;

Voxel3i block_of(const Voxel3i& v) { return {v.x() >> kBits, v.y() >> kBits, v.z() >> kBits}; }

int cell_of(const Voxel3i& v) {
  return (v.x() & kMask) | ((v.y() & kMask) << kBits) | ((v.z() & kMask) << (2 * kBits));
}

// Offset of neighbour number 0..26; number 13 is the voxel (or block) itself.
Voxel3i neighbour_offset(int k) { return {k % 3 - 1, (k / 3) % 3 - 1, k / 9 - 1}; }

// For a cell of a block and one of its 27 neighbours: which of the 27 blocks it is in, and which cell there.
struct Step {
  std::uint8_t block, cell;
};

struct Tables {
  std::array<std::array<Step, 27>, 64> steps;
  std::array<std::uint8_t, 27> near_first;  // neighbour numbers: the voxel itself, faces, edges, corners
  std::array<Eigen::Vector3f, 27> offset;

  Tables() {
    for (int c = 0; c < 64; ++c) {
      const Voxel3i cell(c & kMask, (c >> kBits) & kMask, c >> (2 * kBits));
      for (int k = 0; k < 27; ++k) {
        const Voxel3i v = cell + neighbour_offset(k);
        const Voxel3i b = block_of(v);
        steps[static_cast<std::size_t>(c)][static_cast<std::size_t>(k)] = {
            static_cast<std::uint8_t>((b.x() + 1) + 3 * (b.y() + 1) + 9 * (b.z() + 1)),
            static_cast<std::uint8_t>(cell_of(v))};
      }
    }
    for (std::size_t k = 0; k < 27; ++k) {
      near_first[k] = static_cast<std::uint8_t>(k);
      offset[k] = neighbour_offset(static_cast<int>(k)).cast<float>();
    }
    std::stable_sort(near_first.begin(), near_first.end(), [&](int a, int b) {
      return offset[static_cast<std::size_t>(a)].squaredNorm() <
             offset[static_cast<std::size_t>(b)].squaredNorm();
    });
  }
};

const Tables& tables() {
  static const Tables t;
  return t;
}

}  // namespace

LocalMap::LocalMap(double voxel_size_m, int max_points_per_voxel, double min_spacing_m)
    : voxel_size_(voxel_size_m),
      inverse_voxel_size_(1.0 / voxel_size_m),
      capacity_(static_cast<std::size_t>(std::clamp(max_points_per_voxel, 1, 255))),
      min_spacing_(min_spacing_m),
      min_spacing2_(static_cast<float>(min_spacing_m * min_spacing_m)) {}

VoxelPoint LocalMap::locate(const Eigen::Vector3d& p) const {
  const Eigen::Vector3d scaled = p * inverse_voxel_size_;
  Voxel3i v;
  for (int a = 0; a < 3; ++a) {
    const int truncated = static_cast<int>(scaled[a]);
    v[a] = truncated - (scaled[a] < truncated ? 1 : 0);
  }
  return {v, (p - v.cast<double>() * voxel_size_).cast<float>()};
}

std::int32_t LocalMap::find_block(const Voxel3i& block) const {
  const auto it = block_index_.find(voxel_key(block));
  return it == block_index_.end() ? -1 : it->second;
}

std::int32_t LocalMap::find_or_add_block(const Voxel3i& block) {
  const std::int32_t found = find_block(block);
  if (found >= 0) return found;
  std::int32_t b = 0;
  if (free_blocks_.empty()) {
    b = static_cast<std::int32_t>(blocks_.size());
    blocks_.emplace_back();
  } else {
    b = free_blocks_.back();
    free_blocks_.pop_back();
  }
  Block& fresh = blocks_[static_cast<std::size_t>(b)];
  fresh.coordinates = block;
  fresh.used = true;
  fresh.cells.fill(-1);
  for (int k = 0; k < 27; ++k) {
    const std::int32_t other = k == 13 ? b : find_block(block + neighbour_offset(k));
    fresh.neighbours[static_cast<std::size_t>(k)] = other;
    if (other >= 0) blocks_[static_cast<std::size_t>(other)].neighbours[static_cast<std::size_t>(26 - k)] = b;
  }
  block_index_.insert({voxel_key(block), b});
  return b;
}

void LocalMap::remove_block(std::int32_t index) {
  Block& block = blocks_[static_cast<std::size_t>(index)];
  for (std::size_t c = 0; c < 64; ++c) {
    const std::int32_t v = block.cells[c];
    if (v < 0) continue;
    Voxel& voxel = voxels_[static_cast<std::size_t>(v)];
    mark_neighbours_stale(voxel.coordinates);
    point_count_ -= static_cast<std::size_t>(voxel.count);
    voxel.count = 0;
    free_voxels_.push_back(v);
  }
  for (std::size_t k = 0; k < 27; ++k) {
    const std::int32_t other = block.neighbours[k];
    if (other >= 0 && k != 13) blocks_[static_cast<std::size_t>(other)].neighbours[26 - k] = -1;
  }
  block_index_.erase(voxel_key(block.coordinates));
  block.used = false;
  free_blocks_.push_back(index);
}

std::int32_t LocalMap::add_voxel(const Voxel3i& coordinates) {
  std::int32_t v = 0;
  if (free_voxels_.empty()) {
    v = static_cast<std::int32_t>(voxels_.size());
    voxels_.emplace_back();
    planarities_.emplace_back();
    points_.resize(points_.size() + capacity_);
  } else {
    v = free_voxels_.back();
    free_voxels_.pop_back();
  }
  Voxel& voxel = voxels_[static_cast<std::size_t>(v)];
  voxel.coordinates = coordinates;
  voxel.count = 0;
  voxel.stale = true;
  voxel.moments = Moments();
  return v;
}

bool LocalMap::add_point(std::int32_t index, const Eigen::Vector3f& offset) {
  Voxel& voxel = voxels_[static_cast<std::size_t>(index)];
  const auto count = static_cast<std::size_t>(voxel.count);
  if (count >= capacity_) return false;
  Eigen::Vector3f* points = &points_[static_cast<std::size_t>(index) * capacity_];
  for (std::size_t s = 0; s < count; ++s) {
    if ((points[s] - offset).squaredNorm() < min_spacing2_) return false;
  }
  points[count] = offset;
  voxel.moments.add(offset.cast<double>());
  ++voxel.count;
  ++point_count_;
  return true;
}

template <class Visit>
void LocalMap::for_each_neighbour(const Voxel3i& voxel, const Visit& visit) const {
  const std::int32_t centre = find_block(block_of(voxel));
  if (centre < 0) return;  // callers ask for voxels that exist
  const Block& block = blocks_[static_cast<std::size_t>(centre)];
  const auto& steps = tables().steps[static_cast<std::size_t>(cell_of(voxel))];
  for (int k = 0; k < 27; ++k) {
    const Step step = steps[static_cast<std::size_t>(k)];
    const std::int32_t b = block.neighbours[step.block];
    if (b < 0) continue;
    const std::int32_t v = blocks_[static_cast<std::size_t>(b)].cells[step.cell];
    if (v >= 0) visit(v, k);
  }
}

void LocalMap::mark_neighbours_stale(const Voxel3i& voxel) {
  for_each_neighbour(voxel, [&](std::int32_t v, int) { voxels_[static_cast<std::size_t>(v)].stale = true; });
}

void LocalMap::insert(const std::vector<Eigen::Vector3f>& points, const Pose& map_from_points) {
  const Eigen::Matrix3d r = map_from_points.rotation.toRotationMatrix();
  touched_.clear();
  Voxel3i last_block(std::numeric_limits<int>::max(), 0, 0);
  std::int32_t b = -1;
  for (const Eigen::Vector3f& p : points) {
    const VoxelPoint at = locate(r * p.cast<double>() + map_from_points.translation);
    const Voxel3i block = block_of(at.voxel);
    if (block != last_block) {
      b = find_or_add_block(block);
      last_block = block;
    }
    const auto cell = static_cast<std::size_t>(cell_of(at.voxel));
    std::int32_t v = blocks_[static_cast<std::size_t>(b)].cells[cell];
    if (v < 0) {
      v = add_voxel(at.voxel);
      blocks_[static_cast<std::size_t>(b)].cells[cell] = v;
    }
    if (add_point(v, at.offset)) touched_.push_back(v);
  }
  for (const std::int32_t v : touched_)
    mark_neighbours_stale(voxels_[static_cast<std::size_t>(v)].coordinates);
}

void LocalMap::remove_far(const Eigen::Vector3d& centre, double radius_m) {
  const double edge = voxel_size_ * (1 << kBits);
  const double radius2 = radius_m * radius_m;
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    const Block& block = blocks_[b];
    if (!block.used) continue;
    const Eigen::Vector3d middle = (block.coordinates.cast<double>() + Eigen::Vector3d::Constant(0.5)) * edge;
    if ((middle - centre).squaredNorm() > radius2) remove_block(static_cast<std::int32_t>(b));
  }
}

NearestPoint LocalMap::nearest(const VoxelPoint& q) const {
  // Another point this much farther than the nearest one is of no interest: voxels beyond that are skipped.
  constexpr float kMargin = 0.15F;
  const auto edge = static_cast<float>(voxel_size_);
  const Tables& t = tables();
  const Voxel3i centre_block = block_of(q.voxel);
  const std::int32_t centre = find_block(centre_block);
  const Block* block = centre >= 0 ? &blocks_[static_cast<std::size_t>(centre)] : nullptr;
  const auto& steps = t.steps[static_cast<std::size_t>(cell_of(q.voxel))];

  // Squared distance from the query to the slab of voxels at -1, 0, +1 along each axis.
  const Eigen::Vector3f low = q.offset;
  const Eigen::Vector3f high = Eigen::Vector3f::Constant(edge) - q.offset;
  float slab[3][3];
  for (int a = 0; a < 3; ++a) {
    slab[a][0] = low[a] * low[a];
    slab[a][1] = 0.0F;
    slab[a][2] = high[a] * high[a];
  }

  NearestPoint best;
  float best2 = std::numeric_limits<float>::infinity();
  const float beyond =
      edge + std::min(low.minCoeff(), high.minCoeff());  // nothing else within the 27 voxels' box
  float other2 = beyond * beyond;
  float cutoff2 = other2;
  for (const std::uint8_t k : t.near_first) {
    const float bound2 = slab[0][k % 3] + slab[1][(k / 3) % 3] + slab[2][k / 9];
    if (bound2 >= cutoff2 && best.voxel >= 0) {
      other2 = std::min(other2, bound2);
      continue;
    }
    const Step step = steps[k];
    const std::int32_t b = block != nullptr ? block->neighbours[step.block]
                                            : find_block(centre_block + neighbour_offset(step.block));
    if (b < 0) continue;
    const std::int32_t v = blocks_[static_cast<std::size_t>(b)].cells[step.cell];
    if (v < 0) continue;
    const Eigen::Vector3f from_corner = q.offset - t.offset[k] * edge;
    const Eigen::Vector3f* points = &points_[static_cast<std::size_t>(v) * capacity_];
    for (std::int32_t s = 0; s < voxels_[static_cast<std::size_t>(v)].count; ++s) {
      const float d2 = (points[s] - from_corner).squaredNorm();
      if (d2 < best2) {
        if (best.voxel >= 0) other2 = std::min(other2, best2);
        best2 = d2;
        best.voxel = v;
        best.slot = s;
        const float reach = std::sqrt(best2) + kMargin;
        cutoff2 = reach * reach;
      } else {
        other2 = std::min(other2, d2);
      }
    }
  }
  best.distance_m = std::sqrt(best2);
  best.other_distance_m = std::sqrt(other2);
  return best;
}

Moments LocalMap::neighbourhood_moments(std::int32_t index) const {
  Moments sum;
  for_each_neighbour(voxel_coordinates(index), [&](std::int32_t v, int k) {
    sum.add_shifted(voxels_[static_cast<std::size_t>(v)].moments,
                    neighbour_offset(k).cast<double>() * voxel_size_);
  });
  return sum;
}

void LocalMap::update_planarity(std::int32_t index) {
  planarities_[static_cast<std::size_t>(index)] = analyse(neighbourhood_moments(index));
  voxels_[static_cast<std::size_t>(index)].stale = false;
}

void LocalMap::save(ByteWriter& out) const {
  out.put(static_cast<std::uint64_t>(voxel_count()));
  for_each_voxel([&](std::int32_t i) {
    const Voxel& voxel = voxels_[static_cast<std::size_t>(i)];
    out.put(voxel.coordinates);
    out.put(voxel.count);
    for (std::int32_t s = 0; s < voxel.count; ++s) out.put(point_offset(i, s));
  });
}

void LocalMap::load(ByteReader& in) {
  *this = LocalMap(voxel_size_, static_cast<int>(capacity_), min_spacing_);
  const auto count = in.take<std::uint64_t>();
  for (std::uint64_t i = 0; i < count; ++i) {
    const auto coordinates = in.take<Voxel3i>();
    const auto points = in.take<std::int32_t>();
    if (points < 1 || static_cast<std::size_t>(points) > capacity_)
      in.fail("local map, voxel " + std::to_string(i));
    const std::int32_t b = find_or_add_block(block_of(coordinates));
    const auto cell = static_cast<std::size_t>(cell_of(coordinates));
    if (blocks_[static_cast<std::size_t>(b)].cells[cell] >= 0)
      in.fail("local map, voxel " + std::to_string(i));
    const std::int32_t v = add_voxel(coordinates);
    blocks_[static_cast<std::size_t>(b)].cells[cell] = v;
    Voxel& voxel = voxels_[static_cast<std::size_t>(v)];
    for (std::int32_t s = 0; s < points; ++s) {
      const auto offset = in.take<Eigen::Vector3f>();
      // Offsets lie in the voxel, up to the rounding of far coordinates.
      const auto margin = static_cast<float>(1e-3 * voxel_size_);
      if (!(offset.allFinite() && offset.minCoeff() >= -margin &&
            offset.maxCoeff() <= static_cast<float>(voxel_size_) + margin))
        in.fail("local map, voxel " + std::to_string(i));
      points_[static_cast<std::size_t>(v) * capacity_ + static_cast<std::size_t>(s)] = offset;
      voxel.moments.add(offset.cast<double>());
    }
    voxel.count = points;
    point_count_ += static_cast<std::size_t>(points);
  }
}

}  // namespace hp2
