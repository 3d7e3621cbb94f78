#include "common/transport/convert.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/transport/convert_checks.hpp"

namespace hp2 {
namespace {

std::int8_t to_byte(float unit) {
  return static_cast<std::int8_t>(std::lround(std::clamp(unit, -1.0F, 1.0F) * 127.0F));
}

// Of unit length to 1/127. Not normalised: rounded again it must give the same bytes, so that a submap is bit
// for bit the same from the network and from disk.
Eigen::Vector3f to_normal(std::int8_t x, std::int8_t y, std::int8_t z) {
  return Eigen::Vector3f(x, y, z) / 127.0F;
}

submap_scan_t to_message(const ScanPose& scan) {
  submap_scan_t m{};
  m.sequence = scan.sequence;
  m.utime = scan.utime;
  m.submap_from_sensor = to_message(scan.submap_from_sensor);
  from_matrix(scan.covariance, m.covariance);
  m.state = static_cast<std::int8_t>(scan.state);
  m.alpha = scan.diagnostics.alpha;
  m.sigma = scan.diagnostics.sigma;
  m.min_eigenvalue_ratio = scan.diagnostics.min_eigenvalue_ratio;
  m.iterations = scan.diagnostics.iterations;
  std::copy(scan.diagnostics.ms.begin(), scan.diagnostics.ms.end(), m.ms);
  return m;
}

std::optional<ScanPose> to_scan_pose(const submap_scan_t& m) {
  const auto pose = to_pose(m.submap_from_sensor);
  if (!pose || !all_finite(m.covariance) || m.state < 0 || m.state > 2 || !sane_time(m.utime))
    return std::nullopt;
  ScanPose scan;
  scan.sequence = m.sequence;
  scan.utime = m.utime;
  scan.submap_from_sensor = *pose;
  scan.covariance = to_matrix(m.covariance);
  scan.state = static_cast<TrackingState>(m.state);
  scan.diagnostics.alpha = m.alpha;
  scan.diagnostics.sigma = m.sigma;
  scan.diagnostics.min_eigenvalue_ratio = m.min_eigenvalue_ratio;
  scan.diagnostics.iterations = m.iterations;
  std::copy(std::begin(m.ms), std::end(m.ms), scan.diagnostics.ms.begin());
  return scan;
}

}  // namespace

std::optional<Pose> to_pose(const pose_t& m) {
  if (!all_finite(m.translation) || !all_finite(m.rotation)) return std::nullopt;
  const Eigen::Quaterniond q(m.rotation[0], m.rotation[1], m.rotation[2], m.rotation[3]);
  const Eigen::Vector3d t(m.translation[0], m.translation[1], m.translation[2]);
  if (std::abs(q.norm() - 1.0) > 1e-3 || t.cwiseAbs().maxCoeff() > 1e7) return std::nullopt;
  Pose pose;
  // A quaternion that is of unit length to rounding is taken as it is: normalising it again would change its
  // last bit.
  pose.rotation = std::abs(q.squaredNorm() - 1.0) < 1e-14 ? q : q.normalized();
  pose.translation = t;
  return pose;
}

pose_t to_message(const Pose& pose) {
  pose_t m{};
  for (int i = 0; i < 3; ++i) m.translation[i] = pose.translation[i];
  m.rotation[0] = pose.rotation.w();
  m.rotation[1] = pose.rotation.x();
  m.rotation[2] = pose.rotation.y();
  m.rotation[3] = pose.rotation.z();
  return m;
}

ByteVector encode_submap(const SubmapPackage& package, std::int64_t session_id) {
  const Submap& submap = package.submap;
  submap_t m;
  m.session_id = session_id;
  m.id = submap.id;
  m.odom_from_submap = to_message(submap.odom_from_submap);
  m.travelled = submap.travelled_m;
  m.last = package.last ? 1 : 0;
  const std::size_t n = submap.points.size();
  m.n = static_cast<std::int32_t>(n);
  for (auto* array : {&m.x, &m.y, &m.z}) array->resize(n);
  for (auto* array : {&m.nx, &m.ny, &m.nz}) array->resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    m.x[i] = submap.points[i].x();
    m.y[i] = submap.points[i].y();
    m.z[i] = submap.points[i].z();
    if (i >= submap.normals.size()) continue;
    m.nx[i] = to_byte(submap.normals[i].x());
    m.ny[i] = to_byte(submap.normals[i].y());
    m.nz[i] = to_byte(submap.normals[i].z());
  }
  m.scan_index = submap.scan_indices;
  m.scan_index.resize(n);
  m.n_scans = static_cast<std::int32_t>(submap.scans.size());
  for (const auto& scan : submap.scans) m.scans.push_back(to_message(scan));
  m.n_scans_skipped = submap.scans_skipped;
  m.state_size = static_cast<std::int32_t>(package.frontend_state.size());
  m.state = package.frontend_state;
  return encode_message(m);
}

std::optional<SubmapPackage> decode_submap(const std::uint8_t* data, std::size_t size,
                                           std::int64_t session_id) {
  submap_t m;
  if (!safe_decode(data, size, m) || m.session_id != session_id || m.id < 0 || m.n_scans_skipped < 0) {
    return std::nullopt;
  }
  const auto keypose = to_pose(m.odom_from_submap);
  if (!keypose || !std::isfinite(m.travelled) || !all_finite(m.x) || !all_finite(m.y) || !all_finite(m.z)) {
    return std::nullopt;
  }
  SubmapPackage package;
  Submap& submap = package.submap;
  submap.id = m.id;
  submap.odom_from_submap = *keypose;
  submap.travelled_m = m.travelled;
  submap.scans_skipped = m.n_scans_skipped;
  std::int64_t previous = -1;
  for (const auto& scan_message : m.scans) {
    auto scan = to_scan_pose(scan_message);
    if (!scan || scan->sequence <= previous) return std::nullopt;
    previous = scan->sequence;
    submap.scans.push_back(std::move(*scan));
  }
  const auto n = static_cast<std::size_t>(m.n);
  submap.points.resize(n);
  submap.normals.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (m.scan_index[i] < 0 || m.scan_index[i] >= m.n_scans) return std::nullopt;
    submap.points[i] = {m.x[i], m.y[i], m.z[i]};
    submap.normals[i] = to_normal(m.nx[i], m.ny[i], m.nz[i]);
  }
  submap.scan_indices = std::move(m.scan_index);
  package.frontend_state = std::move(m.state);
  package.last = m.last != 0;
  return package;
}
}  // namespace hp2
