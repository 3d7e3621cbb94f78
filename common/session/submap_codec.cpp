#include "common/session/submap_codec.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "common/session/damage.hpp"

namespace hp2 {
namespace {

// Catches a flipped bit that SQLite, which has no page checksums, would hand out as data. FNV-1a, eight bytes
// at a time; the shift brings the upper bits of a word down, where the next factor spreads them.
std::uint64_t checksum(const std::uint8_t* p, std::size_t n) {
  std::uint64_t h = 1469598103934665603ULL;
  const auto take = [&h](std::uint64_t word) {
    h = (h ^ word) * 1099511628211ULL;
    h ^= h >> 32;
  };
  for (; n >= 8; p += 8, n -= 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, p, 8);
    take(word);
  }
  for (; n > 0; ++p, --n) take(*p);
  return h;
}

// Of versions 1 and 2: byte by byte.
std::uint64_t old_checksum(const std::uint8_t* p, std::size_t n) {
  std::uint64_t h = 1469598103934665603ULL;
  for (std::size_t i = 0; i < n; ++i) h = (h ^ p[i]) * 1099511628211ULL;
  return h;
}

constexpr std::size_t kPointBytes = 12 + 3 + 4;

std::int8_t quantised(float v) {
  return static_cast<std::int8_t>(std::lround(127.0F * std::clamp(v, -1.0F, 1.0F)));
}

}  // namespace

void BlobWriter::put_matrix(const Matrix6d& matrix) {
  for (int i = 0; i < 36; ++i) put(matrix(i / 6, i % 6));
}

void BlobWriter::put_text(const std::string& text) {
  put(static_cast<std::uint32_t>(text.size()));
  bytes_.insert(bytes_.end(), text.begin(), text.end());
}

void BlobWriter::put_pose(const Pose& pose) {
  for (int i = 0; i < 4; ++i) put(pose.rotation.coeffs()[i]);
  for (int i = 0; i < 3; ++i) put(pose.translation[i]);
}

std::vector<std::uint8_t> BlobWriter::finish() {
  put(checksum(bytes_.data(), bytes_.size()));
  return std::move(bytes_);
}

BlobReader::BlobReader(const std::vector<std::uint8_t>& bytes, std::string where)
    : bytes_(bytes), where_(std::move(where)) {
  std::uint64_t stored = 0;
  if (bytes.size() >= sizeof(stored)) {
    end_ = bytes.size() - sizeof(stored);
    std::memcpy(&stored, bytes.data() + end_, sizeof(stored));
  }
  const bool fits = bytes.size() >= sizeof(stored) &&
                    (checksum(bytes.data(), end_) == stored || old_checksum(bytes.data(), end_) == stored);
  if (!fits) throw damage("a checksum does not fit", where_);
}

void BlobReader::take(void* to, std::size_t n) { std::memcpy(to, skip(n), n); }

const std::uint8_t* BlobReader::skip(std::size_t n) {
  if (n > left()) throw damage("a record is too short", where_);
  at_ += n;
  return bytes_.data() + (at_ - n);
}

Pose BlobReader::get_pose() {
  // Not through the normalising constructor: the pose must be bit for bit the stored one.
  Pose pose;
  for (int i = 0; i < 4; ++i) pose.rotation.coeffs()[i] = get<double>();
  for (int i = 0; i < 3; ++i) pose.translation[i] = get<double>();
  return pose;
}

Matrix6d BlobReader::get_matrix() {
  Matrix6d m;
  for (int i = 0; i < 36; ++i) m(i / 6, i % 6) = get<double>();
  return m;
}

std::string BlobReader::get_text() {
  const auto n = get<std::uint32_t>();
  const auto* p = reinterpret_cast<const char*>(skip(n));
  return {p, n};
}

std::vector<std::uint8_t> encode_points(const Submap& submap) {
  BlobWriter out;
  const std::size_t n = submap.points.size();
  out.put(static_cast<std::uint64_t>(n));
  std::uint8_t* p = out.room(n * kPointBytes);
  for (std::size_t i = 0; i < n; ++i, p += kPointBytes) {
    std::int8_t normal[3] = {};
    for (int k = 0; k < 3 && i < submap.normals.size(); ++k) normal[k] = quantised(submap.normals[i][k]);
    const std::int32_t scan = i < submap.scan_indices.size() ? submap.scan_indices[i] : 0;
    std::memcpy(p, submap.points[i].data(), 12);
    std::memcpy(p + 12, normal, 3);
    std::memcpy(p + 15, &scan, 4);
  }
  return out.finish();
}

void decode_points(const std::vector<std::uint8_t>& bytes, const std::string& where, Submap& submap) {
  BlobReader in(bytes, where);
  const auto n =
      static_cast<std::size_t>(std::min<std::uint64_t>(in.get<std::uint64_t>(), in.left() / kPointBytes));
  const std::uint8_t* p = in.skip(n * kPointBytes);
  submap.points.resize(n);
  submap.normals.resize(n);
  submap.scan_indices.resize(n);
  for (std::size_t i = 0; i < n; ++i, p += kPointBytes) {
    std::int8_t normal[3];
    std::memcpy(submap.points[i].data(), p, 12);
    std::memcpy(normal, p + 12, 3);
    std::memcpy(&submap.scan_indices[i], p + 15, 4);
    // Not normalised: that would round to other bytes the next time, and a restarted back-end would see other
    // normals than one that was not.
    for (int k = 0; k < 3; ++k) submap.normals[i][k] = static_cast<float>(normal[k]) / 127.0F;
  }
}

std::vector<std::uint8_t> encode_scans(const std::vector<ScanPose>& scans) {
  BlobWriter out;
  out.put(static_cast<std::uint64_t>(scans.size()));
  for (const ScanPose& s : scans) {
    out.put(s.sequence);
    out.put(s.utime);
    out.put_pose(s.submap_from_sensor);
    out.put_matrix(s.covariance);
    out.put(static_cast<std::uint8_t>(s.state));
    out.put(s.diagnostics.alpha);
    out.put(s.diagnostics.sigma);
    out.put(s.diagnostics.min_eigenvalue_ratio);
    out.put(static_cast<std::int32_t>(s.diagnostics.iterations));
    for (const float ms : s.diagnostics.ms) out.put(ms);
  }
  return out.finish();
}

std::vector<ScanPose> decode_scans(const std::vector<std::uint8_t>& bytes, const std::string& where) {
  BlobReader in(bytes, where);
  constexpr std::size_t kScanBytes = 8 + 8 + 56 + 288 + 1 + 12 + 4 + 24;
  const auto n =
      static_cast<std::size_t>(std::min<std::uint64_t>(in.get<std::uint64_t>(), in.left() / kScanBytes));
  std::vector<ScanPose> scans(n);
  for (ScanPose& s : scans) {
    s.sequence = in.get<std::int64_t>();
    s.utime = in.get<std::int64_t>();
    s.submap_from_sensor = in.get_pose();
    s.covariance = in.get_matrix();
    s.state = static_cast<TrackingState>(in.get<std::uint8_t>());
    s.diagnostics.alpha = in.get<float>();
    s.diagnostics.sigma = in.get<float>();
    s.diagnostics.min_eigenvalue_ratio = in.get<float>();
    s.diagnostics.iterations = in.get<std::int32_t>();
    for (float& ms : s.diagnostics.ms) ms = in.get<float>();
  }
  return scans;
}

std::vector<std::uint8_t> encode_final_poses(const std::vector<TrajectoryPose>& poses) {
  BlobWriter out;
  out.put(static_cast<std::uint64_t>(poses.size()));
  for (const TrajectoryPose& p : poses) {
    out.put(p.sequence);
    out.put(p.utime);
    out.put_pose(p.odom_from_sensor);
    out.put_pose(p.map_from_sensor);
  }
  return out.finish();
}

std::vector<TrajectoryPose> decode_final_poses(const std::vector<std::uint8_t>& bytes,
                                               const std::string& where, std::int64_t submap) {
  BlobReader in(bytes, where);
  constexpr std::size_t kBytes = 8 + 8 + 56 + 56;
  const auto n =
      static_cast<std::size_t>(std::min<std::uint64_t>(in.get<std::uint64_t>(), in.left() / kBytes));
  std::vector<TrajectoryPose> poses(n);
  for (TrajectoryPose& p : poses) {
    p.sequence = in.get<std::int64_t>();
    p.utime = in.get<std::int64_t>();
    p.submap = submap;
    p.odom_from_sensor = in.get_pose();
    p.map_from_sensor = in.get_pose();
  }
  return poses;
}

std::vector<std::uint8_t> encode_poses(const std::vector<Pose>& poses) {
  BlobWriter out;
  out.put(static_cast<std::uint64_t>(poses.size()));
  for (const Pose& p : poses) out.put_pose(p);
  return out.finish();
}

std::vector<Pose> decode_poses(const std::vector<std::uint8_t>& bytes, const std::string& where) {
  BlobReader in(bytes, where);
  const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(in.get<std::uint64_t>(), in.left() / 56));
  std::vector<Pose> poses(n);
  for (Pose& p : poses) p = in.get_pose();
  return poses;
}

}  // namespace hp2
