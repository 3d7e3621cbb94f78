#include "player/calibration/calibration_window.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace hp2 {

WindowCutter::WindowCutter(const WindowConfig& config, const std::vector<double>& rings)
    : config_(config), one_ring_(rings.empty()), table_(rings) {}

std::vector<CalibrationPoint> WindowCutter::thinned(const Scan& scan) const {
  // An odd step meets every ring where the points are sorted by firing.
  std::size_t step = std::max<std::size_t>(scan.size() / config_.points_per_scan, 1);
  if (step % 2 == 0) ++step;
  const bool timed = scan.time.size() == scan.size() && scan.duration_us > 0;
  std::vector<CalibrationPoint> points;
  points.reserve(scan.size() / step + 1);
  for (std::size_t i = 0; i < scan.size(); i += step) {
    const Eigen::Vector3f p(scan.x[i], scan.y[i], scan.z[i]);
    const float range = p.norm();
    if (!(range >= config_.min_range_m && range <= config_.max_range_m)) continue;
    const std::int16_t ring = one_ring_ ? std::int16_t{0} : table_.ring(p.z() / range);
    if (ring < 0) continue;
    points.push_back({p, timed ? std::clamp(scan.time[i], 0.0F, 1.0F) : 1.0F, ring});
  }
  return points;
}

std::optional<CalibrationWindow> WindowCutter::add(const Scan& scan, const Pose& odom_from_sensor) {
  const std::int64_t step_us = scan.utime_end() - last_utime_;
  const std::optional<Pose> before = std::exchange(last_pose_, odom_from_sensor);
  last_utime_ = scan.utime_end();
  if (!before || step_us <= 0) return std::nullopt;
  if (last_taken_) {
    const Pose moved = last_taken_->inverse() * odom_from_sensor;
    if (moved.translation.norm() < config_.spacing_m && rotation_angle(moved.rotation) < config_.spacing_rad)
      return std::nullopt;
  }
  last_taken_ = odom_from_sensor;
  const double share = static_cast<double>(scan.duration_us) / static_cast<double>(step_us);
  const Vector6d twist = std::min(share, 2.0) * se3_log(before->inverse() * odom_from_sensor);
  window_.push_back({odom_from_sensor, twist, thinned(scan)});
  if (window_.size() < config_.scans_per_window) return std::nullopt;
  const Pose origin = window_.front().map_from_sensor.inverse();
  for (CalibrationScan& s : window_) s.map_from_sensor = origin * s.map_from_sensor;
  return std::exchange(window_, {});
}

}  // namespace hp2
