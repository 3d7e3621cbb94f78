#include "frontend/odometry/preprocess.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace hp2 {
namespace {

constexpr std::size_t kParts = 4;     // of a scan
constexpr int kAxisBits = 10;         // of a voxel coordinate in a key
constexpr std::size_t kChunk = 1024;  // points whose keys are computed at a time

// Keys of voxels of edge `voxel` within `range` of the sensor fit kAxisBits per axis; voxels are coarser if
// they would not.
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

constexpr std::uint32_t kHashRange = 1U << 30;  // of a key's hash; as many as Preprocessor::kRanges

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
  slots_.assign(want, kDropped);
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

Preprocessor::Preprocessor(const PreprocessConfig& config) : config_(config), parts_(kParts) {}

// The points of one part of the scan that may be the first of their voxel. Neighbours in a sweep fall in the
// same few voxels: most duplicates are found among the part's last keys.
void Preprocessor::find_candidates(const Scan& scan, std::size_t begin, std::size_t end, Part& part) const {
  const float inverse_map = 1.0F / usable_voxel(config_.map_voxel_m, config_.max_range_m);
  const float inverse_source = 1.0F / usable_voxel(config_.source_voxel_m, config_.max_range_m);
  const auto min2 = static_cast<float>(config_.min_range_m * config_.min_range_m);
  const auto max2 = static_cast<float>(config_.max_range_m * config_.max_range_m);
  std::array<std::uint32_t, kChunk> keys;
  for (std::size_t first = begin; first < end; first += kChunk) {
    const std::size_t last = std::min(end, first + kChunk);
    voxel_keys(scan, first, last, min2, max2, inverse_map, keys.data());
    for (std::size_t i = first; i < last; ++i) {
      const std::uint32_t key = keys[i - first];
      const std::uint32_t hash = spread(key);
      std::uint32_t& recent = part.recent[hash >> (32 - kRecentBits)];
      if (recent == key) {
        part.dropped += key == kDropped ? 1 : 0;
        continue;
      }
      if (key == kDropped) {
        ++part.dropped;
        continue;
      }
      recent = key;
      const auto index = static_cast<std::uint32_t>(part.scan_index.size());
      const std::uint32_t source = voxel_key(scan.x[i], scan.y[i], scan.z[i], inverse_source);
      part.scan_index.push_back(static_cast<std::uint32_t>(i));
      part.map[hash / kHashRange].push_back({index, key});
      part.source[spread(source) / kHashRange].push_back({index, source});
    }
  }
}

void Preprocessor::copy_out(const Scan& scan, bool use_time, Part& part, PreprocessedScan& out) const {
  std::size_t point = part.first_point, source = part.first_source;
  float farthest2 = 0.0F;
  for (std::size_t j = 0; j < part.kept.size(); ++j) {
    if (part.kept[j] == 0) continue;
    const std::uint32_t i = part.scan_index[j];
    const Eigen::Vector3f p(scan.x[i], scan.y[i], scan.z[i]);
    farthest2 = std::max(farthest2, p.squaredNorm());
    out.points[point] = p;
    if (use_time) out.time[point] = scan.time[i];
    if (part.kept[j] == 2) out.source[source++] = static_cast<std::uint32_t>(point);
    ++point;
  }
  part.farthest2 = farthest2;
}

void Preprocessor::run(const Scan& scan, bool use_time, const Parallel& parallel, PreprocessedScan& out) {
  const std::size_t n = scan.size();
  const std::size_t part_size = std::max<std::size_t>(1, (n + kParts - 1) / kParts);
  for (auto& part : parts_) {
    part.recent.fill(kDropped);
    part.scan_index.clear();
    for (auto& entries : part.map) entries.clear();
    for (auto& entries : part.source) entries.clear();
    part.dropped = 0;
  }
  parallel.for_blocks(n, part_size, [&](std::size_t p, std::size_t begin, std::size_t end) {
    find_candidates(scan, begin, end, parts_[p]);
  });

  // The first of each map voxel, and of these the first of each source voxel: range of hashes by range of
  // hashes, each in the order of the scan. A flag belongs to one candidate, so ranges do not meet.
  for (auto& part : parts_) part.kept.assign(part.scan_index.size(), 0);
  const auto flag_firsts = [&](auto member, std::uint8_t needed, std::size_t share) {
    parallel.for_blocks(kRanges, 1, [&, member, needed](std::size_t range, std::size_t, std::size_t) {
      KeySet& set = sets_[range];
      std::size_t most = 0;
      for (auto& part : parts_) most += (part.*member)[range].size();
      set.clear(most / share);
      for (auto& part : parts_) {
        for (const Entry& e : (part.*member)[range]) {
          if (part.kept[e.index] == needed && set.insert(e.key)) ++part.kept[e.index];
        }
      }
    });
  };
  flag_firsts(&Part::map, 0, 1);
  flag_firsts(&Part::source, 1, 4);

  std::size_t points = 0, sources = 0;
  for (auto& part : parts_) {
    part.first_point = points;
    part.first_source = sources;
    for (const std::uint8_t kept : part.kept) {
      points += kept != 0 ? 1 : 0;
      sources += kept == 2 ? 1 : 0;
    }
  }
  out.points.resize(points);
  out.time.resize(use_time ? points : 0);
  out.source.resize(sources);
  parallel.for_blocks(
      kParts, 1, [&](std::size_t p, std::size_t, std::size_t) { copy_out(scan, use_time, parts_[p], out); });
  out.dropped = 0;
  float farthest2 = 0.0F;
  for (const auto& part : parts_) {
    out.dropped += part.dropped;
    farthest2 = std::max(farthest2, part.farthest2);
  }
  out.max_range_m = std::sqrt(static_cast<double>(farthest2));
}

}  // namespace hp2
