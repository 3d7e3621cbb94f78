#include "frontend/preprocess.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {
namespace {

constexpr std::size_t kParts = 4;  // fixed, so that the result does not depend on the number of threads
constexpr int kAxisBits = 10;      // of a voxel coordinate in a key

// Keys of voxels of edge `voxel` within `range` of the sensor fit kAxisBits an axis; coarser voxels if they
// would not.
float usable_voxel(double voxel_m, double range_m) {
  constexpr double kLargest = (1 << (kAxisBits - 1)) - 1;
  return static_cast<float>(std::max(voxel_m, range_m / kLargest));
}

std::uint32_t voxel_key(float x, float y, float z, float inverse_voxel) {
  // Truncation of a positive number is its floor.
  constexpr float kMiddle = 1 << (kAxisBits - 1);
  const auto i = static_cast<std::uint32_t>(static_cast<std::int32_t>(x * inverse_voxel + kMiddle));
  const auto j = static_cast<std::uint32_t>(static_cast<std::int32_t>(y * inverse_voxel + kMiddle));
  const auto k = static_cast<std::uint32_t>(static_cast<std::int32_t>(z * inverse_voxel + kMiddle));
  return i | (j << kAxisBits) | (k << (2 * kAxisBits));
}

}  // namespace

void Preprocessor::KeySet::clear(std::size_t expected) {
  std::size_t want = 1024;
  while (want < 2 * expected) want *= 2;
  if (slots_.size() < want || generation_ == ~std::uint32_t{0}) {
    slots_.assign(std::max(want, slots_.size()), 0);
    generation_ = 0;
  }
  mask_ = slots_.size() - 1;
  size_ = 0;
  ++generation_;
}

bool Preprocessor::KeySet::insert(std::uint32_t key) {
  if (2 * size_ > mask_) grow();
  const std::uint64_t entry = (static_cast<std::uint64_t>(generation_) << 32) | key;
  std::size_t i = (key * 0x9E3779B1U >> 7) & mask_;
  while ((slots_[i] >> 32) == generation_) {
    if (slots_[i] == entry) return false;
    i = (i + 1) & mask_;
  }
  slots_[i] = entry;
  ++size_;
  return true;
}

void Preprocessor::KeySet::grow() {
  const std::vector<std::uint64_t> old = std::move(slots_);
  const std::uint32_t generation = generation_;
  slots_.assign(2 * old.size(), 0);
  mask_ = slots_.size() - 1;
  size_ = 0;
  for (const std::uint64_t e : old) {
    if ((e >> 32) == generation) insert(static_cast<std::uint32_t>(e));
  }
}

Preprocessor::Preprocessor(const PreprocessConfig& config) : config_(config), parts_(kParts) {}

void Preprocessor::run(const Scan& scan, bool use_time, const Parallel& parallel, PreprocessedScan& out) {
  const std::size_t n = scan.size();
  const float inverse_map = 1.0F / usable_voxel(config_.map_voxel_m, config_.max_range_m);
  const float inverse_source = 1.0F / usable_voxel(config_.source_voxel_m, config_.max_range_m);
  const auto min2 = static_cast<float>(config_.min_range_m * config_.min_range_m);
  const auto max2 = static_cast<float>(config_.max_range_m * config_.max_range_m);

  // Each part of the scan keeps the first point of each of its voxels; merging the parts in order then keeps
  // the first of all: what one pass over the whole scan would keep.
  const std::size_t part_size = std::max<std::size_t>(1, (n + kParts - 1) / kParts);
  for (auto& part : parts_) {
    part.keep.clear();
    part.keys.clear();
    part.dropped = 0;
  }
  parallel.for_blocks(n, part_size, [&](std::size_t p, std::size_t begin, std::size_t end) {
    Part& part = parts_[p];
    part.set.clear(8192);
    for (std::size_t i = begin; i < end; ++i) {
      const float x = scan.x[i], y = scan.y[i], z = scan.z[i];
      const float r2 = x * x + y * y + z * z;
      if (!(r2 >= min2 && r2 <= max2)) {  // false for NaN as well
        ++part.dropped;
        continue;
      }
      const std::uint32_t key = voxel_key(x, y, z, inverse_map);
      if (part.set.insert(key)) {
        part.keep.push_back(static_cast<std::uint32_t>(i));
        part.keys.push_back(key);
      }
    }
  });

  out.points.clear();
  out.time.clear();
  out.source.clear();
  out.dropped = 0;
  float farthest2 = 0.0F;
  std::size_t kept = 0;
  for (const auto& part : parts_) kept += part.keep.size();
  map_set_.clear(kept);
  source_set_.clear(kept / 2);
  for (const auto& part : parts_) {
    out.dropped += part.dropped;
    for (std::size_t j = 0; j < part.keep.size(); ++j) {
      if (!map_set_.insert(part.keys[j])) continue;
      const std::uint32_t i = part.keep[j];
      const float x = scan.x[i], y = scan.y[i], z = scan.z[i];
      if (source_set_.insert(voxel_key(x, y, z, inverse_source))) {
        out.source.push_back(static_cast<std::uint32_t>(out.points.size()));
      }
      out.points.emplace_back(x, y, z);
      farthest2 = std::max(farthest2, out.points.back().squaredNorm());
      if (use_time) out.time.push_back(scan.time[i]);
    }
  }
  out.max_range_m = std::sqrt(static_cast<double>(farthest2));
}

}  // namespace hp2
