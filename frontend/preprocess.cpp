#include "frontend/preprocess.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace hp2 {
namespace {

constexpr std::size_t kParts = 4;  // fixed, so that the result does not depend on the number of threads
constexpr std::uint32_t kHashRange = 1U << 30;  // of a key's hash; kParts of them
constexpr int kAxisBits = 10;                   // of a voxel coordinate in a key
constexpr std::size_t kChunk = 1024;            // points whose keys are computed at a time

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

constexpr std::uint32_t kDropped = ~std::uint32_t{0};  // in place of a key; keys have 30 bits

std::uint32_t spread(std::uint32_t key) { return key * 0x9E3779B1U; }

// Keys of points [begin, end), kDropped where out of range or not finite. One loop without branches.
void voxel_keys(const Scan& scan, std::size_t begin, std::size_t end, float min2, float max2,
                float inverse_voxel, std::uint32_t* keys) {
  const float* xs = scan.x.data() + begin;
  const float* ys = scan.y.data() + begin;
  const float* zs = scan.z.data() + begin;
  const std::size_t n = end - begin;
  for (std::size_t i = 0; i < n; ++i) {
    const float r2 = xs[i] * xs[i] + ys[i] * ys[i] + zs[i] * zs[i];
    const bool good = (r2 >= min2) & (r2 <= max2);  // false for NaN as well
    const float x = good ? xs[i] : 0.0F, y = good ? ys[i] : 0.0F, z = good ? zs[i] : 0.0F;
    const std::uint32_t key = voxel_key(x, y, z, inverse_voxel);
    keys[i] = good ? key : kDropped;
  }
}

}  // namespace

void Preprocessor::KeySet::clear(std::size_t expected) {
  std::size_t want = 1024;
  while (want < 2 * expected) want *= 2;
  slots_.assign(std::max(want, slots_.size()), kDropped);
  mask_ = slots_.size() - 1;
  size_ = 0;
}

bool Preprocessor::KeySet::insert(std::uint32_t key) {
  if (2 * size_ > mask_) grow();
  std::size_t i = (spread(key) >> 7) & mask_;
  while (slots_[i] != kDropped) {
    if (slots_[i] == key) return false;
    i = (i + 1) & mask_;
  }
  slots_[i] = key;
  ++size_;
  return true;
}

void Preprocessor::KeySet::grow() {
  const std::vector<std::uint32_t> old = std::move(slots_);
  slots_.assign(2 * old.size(), kDropped);
  mask_ = slots_.size() - 1;
  size_ = 0;
  for (const std::uint32_t key : old) {
    if (key != kDropped) insert(key);
  }
}

Preprocessor::Preprocessor(const PreprocessConfig& config)
    : config_(config), parts_(kParts), merged_(kParts) {}

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
    part.recent.fill(kDropped);
    std::array<std::uint32_t, kChunk> keys;
    for (std::size_t first = begin; first < end; first += kChunk) {
      const std::size_t last = std::min(end, first + kChunk);
      voxel_keys(scan, first, last, min2, max2, inverse_map, keys.data());
      for (std::size_t i = first; i < last; ++i) {
        const std::uint32_t key = keys[i - first];
        // Neighbours in a sweep fall in the same few voxels: most are known without a look at the set.
        std::uint32_t& recent = part.recent[spread(key) >> (32 - kRecentBits)];
        if (recent == key) {
          part.dropped += key == kDropped ? 1 : 0;
          continue;
        }
        if (key == kDropped) {
          ++part.dropped;
          continue;
        }
        recent = key;
        if (part.set.insert(key)) {
          part.keep.push_back(static_cast<std::uint32_t>(i));
          part.keys.push_back(key);
        }
      }
    }
  });

  // Which keys an earlier part has, range of hashes by range of hashes.
  std::size_t kept = 0;
  for (auto& part : parts_) {
    kept += part.keep.size();
    part.repeated.assign(part.keep.size(), 0);
  }
  parallel.for_blocks(kParts, 1, [&](std::size_t range, std::size_t, std::size_t) {
    KeySet& set = merged_[range];
    set.clear(kept / kParts);
    for (auto& part : parts_) {
      for (std::size_t j = 0; j < part.keys.size(); ++j) {
        if (spread(part.keys[j]) / kHashRange != range) continue;
        if (!set.insert(part.keys[j])) part.repeated[j] = 1;
      }
    }
  });

  out.points.clear();
  out.time.clear();
  out.source.clear();
  out.dropped = 0;
  float farthest2 = 0.0F;
  source_set_.clear(kept / 4);
  for (const auto& part : parts_) {
    out.dropped += part.dropped;
    for (std::size_t j = 0; j < part.keep.size(); ++j) {
      if (part.repeated[j] != 0) continue;
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
