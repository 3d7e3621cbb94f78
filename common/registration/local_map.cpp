#include "common/registration/local_map.hpp"

#include <algorithm>
#include <cmath>

#include "common/registration/local_map_blocks.hpp"

namespace hp2 {

using namespace map_blocks;

LocalMap::LocalMap(double voxel_size_m, int max_points_per_voxel, double min_spacing_m, bool wide)
    : wide_(wide),
      voxel_size_(voxel_size_m),
      inverse_voxel_size_(1.0 / voxel_size_m),
      capacity_(static_cast<std::size_t>(std::clamp(max_points_per_voxel, 1, 255))),
      lines_per_voxel_((capacity_ + kPointsPerLine - 1) / kPointsPerLine),
      min_spacing_(min_spacing_m),
      min_spacing2_(static_cast<float>(min_spacing_m * min_spacing_m)),
      half_(static_cast<float>(0.5 * voxel_size_m)) {}

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

std::int32_t LocalMap::find_block(const Voxel3i& block, Cursor& cursor) const {
  if (cursor.index >= 0) {
    const Voxel3i step = block - cursor.block;
    if (step == Voxel3i::Zero()) return cursor.index;
    if (step.cwiseAbs().maxCoeff() <= 1) {
      const std::int32_t b =
          blocks_[static_cast<std::size_t>(cursor.index)].neighbours[neighbour_number(step)];
      if (b >= 0) cursor = {block, b};
      return b;
    }
  }
  const std::int32_t b = find_block(block);
  if (b >= 0) cursor = {block, b};
  return b;
}

Eigen::Vector3d LocalMap::block_centre(const Voxel3i& block) const {
  return (block.cast<double>() + Eigen::Vector3d::Constant(0.5)) * (voxel_size_ * (1 << kBits));
}

std::int32_t LocalMap::add_block(const Voxel3i& block) {
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
  fresh.occupied = fresh.full = fresh.stale = 0;
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
  for (const std::int32_t v : block.cells) {
    if (v >= 0) mark_neighbours_stale(v);
  }
  for (const std::int32_t v : block.cells) {
    if (v < 0) continue;
    point_count_ -= static_cast<std::size_t>(count(v));
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

std::int32_t LocalMap::find_or_add_voxel(const Voxel3i& coordinates, std::int32_t b) {
  std::int32_t& cell =
      blocks_[static_cast<std::size_t>(b)].cells[static_cast<std::size_t>(cell_of(coordinates))];
  if (cell >= 0) return cell;
  if (free_voxels_.empty()) {
    cell = static_cast<std::int32_t>(voxels_.size());
    voxels_.emplace_back();
    moments_.emplace_back();
    planarities_.emplace_back();
    lines_.resize(lines_.size() + lines_per_voxel_);
    views_.resize(views_.size() + capacity_);
  } else {
    cell = free_voxels_.back();
    free_voxels_.pop_back();
    moments_[static_cast<std::size_t>(cell)] = VoxelMoments();
    std::fill_n(&lines_[static_cast<std::size_t>(cell) * lines_per_voxel_], lines_per_voxel_, Line());
  }
  Voxel& voxel = voxels_[static_cast<std::size_t>(cell)];
  voxel.coordinates = coordinates;
  voxel.block = b;
  voxel.cell = static_cast<std::uint8_t>(cell_of(coordinates));
  const std::uint64_t bit = std::uint64_t{1} << voxel.cell;
  blocks_[static_cast<std::size_t>(b)].occupied |= bit;
  blocks_[static_cast<std::size_t>(b)].stale |= bit;
  return cell;
}

bool LocalMap::has_room(std::int32_t voxel, const Eigen::Vector3f& offset) const {
  const Line* line = &lines_[static_cast<std::size_t>(voxel) * lines_per_voxel_];
  const std::int32_t count = line->count;
  if (static_cast<std::size_t>(count) >= capacity_) return false;
  for (std::int32_t first = 0; first < count; first += kPointsPerLine, ++line) {
    float d2[kPointsPerLine];
    line->distances2(offset, d2);
    for (const float d : d2) {
      if (d < min_spacing2_) return false;
    }
  }
  return true;
}

void LocalMap::set_point(std::int32_t index, std::int32_t s, const Eigen::Vector3f& offset,
                         const View& view) {
  Line& line = lines_[static_cast<std::size_t>(index) * lines_per_voxel_ +
                      static_cast<std::size_t>(s / kPointsPerLine)];
  for (int a = 0; a < 3; ++a) line.xyz[a][s % kPointsPerLine] = offset[a];
  views_[static_cast<std::size_t>(index) * capacity_ + static_cast<std::size_t>(s)] = view;
}

void LocalMap::add_point(std::int32_t index, const Eigen::Vector3f& offset, const View& view) {
  Line& first = lines_[static_cast<std::size_t>(index) * lines_per_voxel_];
  set_point(index, first.count, offset, view);
  ++first.count;
  ++point_count_;
  const Voxel& voxel = voxels_[static_cast<std::size_t>(index)];
  if (static_cast<std::size_t>(first.count) == capacity_) {
    blocks_[static_cast<std::size_t>(voxel.block)].full |= std::uint64_t{1} << voxel.cell;
  }
  add_moments(index, offset);
}

// Computes the sums again in the points' order, as load() does.
void LocalMap::replace_point(std::int32_t index, std::int32_t slot, const Eigen::Vector3f& offset,
                             const View& view) {
  set_point(index, slot, offset, view);
  moments_[static_cast<std::size_t>(index)] = VoxelMoments();
  for (std::int32_t s = 0; s < count(index); ++s) add_moments(index, point_offset(index, s));
}

void LocalMap::add_moments(std::int32_t index, const Eigen::Vector3f& offset) {
  const Voxel& voxel = voxels_[static_cast<std::size_t>(index)];
  const Block& block = blocks_[static_cast<std::size_t>(voxel.block)];
  const Eigen::Vector3d p = voxel.coordinates.cast<double>() * voxel_size_ + offset.cast<double>() -
                            block_centre(block.coordinates);
  const double terms[10] = {1.0,           p.x(),         p.y(),         p.z(),         p.x() * p.x(),
                            p.x() * p.y(), p.x() * p.z(), p.y() * p.y(), p.y() * p.z(), p.z() * p.z()};
  double* v = moments_[static_cast<std::size_t>(index)].v;
  for (int i = 0; i < 10; ++i) v[i] += terms[i];
}

void LocalMap::mark_neighbours_stale(std::int32_t index) {
  const Voxel& voxel = voxels_[static_cast<std::size_t>(index)];
  const Block& block = blocks_[static_cast<std::size_t>(voxel.block)];
  const Reach& reach = wide_ ? tables().wide_reach[voxel.cell] : tables().reach[voxel.cell];
  for (int k = 0; k < reach.blocks; ++k) {
    const auto number = static_cast<std::size_t>(k);
    const std::int32_t b = block.neighbours[reach.block[number]];
    if (b >= 0) blocks_[static_cast<std::size_t>(b)].stale |= reach.cells[number];
  }
}

// Most points fall into voxels that are full already. These points are found in parallel without writing: a
// point without room now has none after others were added.
void LocalMap::find_candidates(const std::vector<Eigen::Vector3f>& points, const Pose& map_from_points,
                               const Parallel& parallel, const std::optional<Eigen::Vector3d>& seen_from) {
  constexpr std::size_t kPart = 2048;
  seen_from_ = seen_from;
  const Eigen::Matrix3d r = map_from_points.rotation.toRotationMatrix();
  const Eigen::Vector3d t = map_from_points.translation;
  candidate_parts_ = Parallel::block_count(points.size(), kPart);
  if (candidates_.size() < candidate_parts_) candidates_.resize(candidate_parts_);
  const Voxel3i origin = locate(t).voxel;
  const Eigen::Matrix3f near_r = r.cast<float>();
  const Eigen::Vector3f near_t = (t - origin.cast<double>() * voxel_size_).cast<float>();
  const auto edge = static_cast<float>(voxel_size_);
  const float inverse_edge = 1.0F / edge;
  parallel.for_blocks(points.size(), kPart, [&](std::size_t part, std::size_t begin, std::size_t end) {
    auto& probes = candidates_[part].probes;
    auto& candidates = candidates_[part].candidates;
    probes.clear();
    candidates.clear();
    Cursor cursor;
    for (std::size_t i = begin; i < end; ++i) {
      const Probe p = probe(locate_near(near_r * points[i] + near_t, origin, edge, inverse_edge), cursor);
      if (p.block < 0) {
        probes.push_back(p);
        continue;
      }
      const Block& block = blocks_[static_cast<std::size_t>(p.block)];
      const int cell = cell_of(p.at.voxel);
      if ((block.full >> cell & 1U) != 0) continue;
      const std::int32_t v = block.cells[static_cast<std::size_t>(cell)];
      if (v >= 0) prefetch_line(v);
      probes.push_back(p);
    }
    for (const Probe& p : probes) {
      const std::int32_t v = p.block < 0 ? -1
                                         : blocks_[static_cast<std::size_t>(p.block)]
                                               .cells[static_cast<std::size_t>(cell_of(p.at.voxel))];
      if (v < 0 || has_room(v, p.at.offset)) candidates.push_back(p);
    }
  });
}

void LocalMap::insert_candidates() {
  touched_.clear();
  Cursor cursor;
  for (std::size_t part = 0; part < candidate_parts_; ++part) {
    for (const Probe& p : candidates_[part].candidates) {
      const VoxelPoint& at = p.at;
      std::int32_t b = p.block;
      if (b < 0) {
        const Voxel3i block = block_of(at.voxel);
        b = find_block(block, cursor);
        if (b < 0) {
          b = add_block(block);
          cursor = {block, b};
        }
      }
      const std::int32_t v = find_or_add_voxel(at.voxel, b);
      if (!has_room(v, at.offset)) continue;
      View view = View::Zero();
      if (seen_from_) {
        view = quantised(*seen_from_ - at.voxel.cast<double>() * voxel_size_ - at.offset.cast<double>());
      }
      add_point(v, at.offset, view);
      touched_.push_back(v);
    }
  }
  if (!all_stale_) {
    for (const std::int32_t v : touched_) mark_neighbours_stale(v);
  }
  candidate_parts_ = 0;
}

std::int32_t LocalMap::voxel_at(const Voxel3i& coordinates) {
  const Voxel3i block = block_of(coordinates);
  const std::int32_t b = find_block(block);
  return find_or_add_voxel(coordinates, b >= 0 ? b : add_block(block));
}

void LocalMap::remove_far(const Eigen::Vector3d& centre, double radius_m) {
  const double radius2 = radius_m * radius_m;
  for (std::size_t b = 0; b < blocks_.size(); ++b) {
    const Block& block = blocks_[b];
    if (!block.used) continue;
    if ((block_centre(block.coordinates) - centre).squaredNorm() > radius2)
      remove_block(static_cast<std::int32_t>(b));
  }
}

}  // namespace hp2
