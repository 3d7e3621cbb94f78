#include "player/synthetic/route.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {
namespace {

using Points = std::vector<Eigen::Vector2d>;

/// A Gaussian over the points; a ring is taken as such, an open line is held at its ends.
Points smooth(const Points& line, double sigma_points, bool ring) {
  const int reach = static_cast<int>(3.5 * sigma_points);
  const int n = static_cast<int>(line.size()) - (ring ? 1 : 0);  // a ring's last point is its first
  Points result(line.size());
  for (int i = 0; i < n; ++i) {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    double weights = 0.0;
    for (int k = -reach; k <= reach; ++k) {
      const double w = std::exp(-0.5 * k * k / (sigma_points * sigma_points));
      const int j = ring ? ((i + k) % n + n) % n : std::clamp(i + k, 0, n - 1);
      sum += w * line[static_cast<std::size_t>(j)];
      weights += w;
    }
    result[static_cast<std::size_t>(i)] = sum / weights;
  }
  if (ring) result.back() = result.front();
  return result;
}

/// Catmull-Rom through points p1 and p2, and its derivative.
struct Curve {
  Eigen::Vector2d position, derivative;
};
Curve catmull_rom(const Points& p, double u) {
  const auto last = static_cast<double>(p.size() - 1);
  u = std::clamp(u, 0.0, last - 1e-9);
  const auto i = static_cast<std::size_t>(u);
  const double t = u - static_cast<double>(i);
  const Eigen::Vector2d& p1 = p[i];
  const Eigen::Vector2d& p2 = p[i + 1];
  // Continued straight beyond the ends.
  const Eigen::Vector2d p0 = i > 0 ? p[i - 1] : Eigen::Vector2d(2.0 * p1 - p2);
  const Eigen::Vector2d p3 = i + 2 < p.size() ? p[i + 2] : Eigen::Vector2d(2.0 * p2 - p1);
  const Eigen::Vector2d a = 0.5 * (-p0 + 3.0 * p1 - 3.0 * p2 + p3);
  const Eigen::Vector2d b = 0.5 * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3);
  const Eigen::Vector2d c = 0.5 * (p2 - p0);
  return {((a * t + b) * t + c) * t + p1, (3.0 * a * t + 2.0 * b) * t + c};
}

/// Points along a polyline, evenly spread over its length: at most `step` apart on the line itself, or just
/// `step` apart on the curve through its points. (On the chords of a bend they would lie now in, now beside
/// it, and the heading would shake by a tenth of what it turns.)
Points resample(const Points& line, double step, bool curved) {
  std::vector<double> at = {0.0};
  for (std::size_t i = 1; i < line.size(); ++i) at.push_back(at.back() + (line[i] - line[i - 1]).norm());
  const auto n = static_cast<std::size_t>(
      std::max(1.0, curved ? std::floor(at.back() / step) : std::ceil(at.back() / step)));
  const double stride = curved ? step : at.back() / static_cast<double>(n);
  Points result;
  std::size_t k = 1;
  for (std::size_t i = 0; i <= n; ++i) {
    const double s = std::min(stride * static_cast<double>(i), at.back());
    while (k + 1 < at.size() && at[k] < s) ++k;
    const double span = at[k] - at[k - 1];
    const double share = span > 0 ? (s - at[k - 1]) / span : 0.0;
    result.push_back(curved ? catmull_rom(line, static_cast<double>(k - 1) + share).position
                            : Eigen::Vector2d(line[k - 1] + (line[k] - line[k - 1]) * share));
  }
  return result;
}

}  // namespace

Route::Route(const std::vector<Eigen::Vector2d>& way_points, const RouteOptions& options,
             const Ground& ground)
    : options_(options), ground_(ground) {
  Points line = way_points;
  if (options.closed) line.push_back(line.front());
  line = smooth(resample(line, kPointStep, false), options.corner_m / kPointStep, options.closed);
  if (options.closed) {
    double length = 0.0;
    const std::size_t ring = line.size() - 1;
    for (std::size_t i = 0; i < ring && length < options.repeat_m; ++i) {
      length += (line[i + 1] - line[i]).norm();
      line.push_back(line[i + 1]);
    }
  }
  line = resample(line, kPointStep, true);

  // Step aside: to the right, and weaving.
  Points aside = line;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const Eigen::Vector2d along = line[std::min(i + 1, line.size() - 1)] - line[i > 0 ? i - 1 : 0];
    const double s = kPointStep * static_cast<double>(i);
    const double right = options.right_m + options.weave_m * std::sin(2.0 * M_PI * s / 73.0);
    aside[i] += right * Eigen::Vector2d(along.y(), -along.x()).normalized();
  }
  points_ = resample(aside, kPointStep, true);

  // Speed: what the bends allow, then what braking and accelerating allow. It begins at walking pace.
  const std::size_t n = points_.size();
  std::vector<double> limit(n, options.max_speed);
  for (std::size_t i = 2; i + 2 < n; ++i) {
    const Eigen::Vector2d a = points_[i] - points_[i - 2];
    const Eigen::Vector2d b = points_[i + 2] - points_[i];
    const double turn = std::atan2(a.x() * b.y() - a.y() * b.x(), a.dot(b));
    const double curvature = std::abs(turn) / (0.5 * (a.norm() + b.norm()));
    limit[i] = std::min(limit[i], std::sqrt(options.lateral_acceleration / std::max(curvature, 1e-4)));
  }
  limit[0] = std::min(limit[0], 1.0);
  const double gain = 2.0 * options.acceleration * kPointStep;
  for (std::size_t i = 1; i < n; ++i)
    limit[i] = std::min(limit[i], std::sqrt(limit[i - 1] * limit[i - 1] + gain));
  for (std::size_t i = n - 1; i-- > 0;)
    limit[i] = std::min(limit[i], std::sqrt(limit[i + 1] * limit[i + 1] + gain));

  double s = 0.0;
  while (s < length()) {
    const double u = s / kPointStep;
    const auto i = std::min(static_cast<std::size_t>(u), n - 2);
    const double speed = limit[i] + (limit[i + 1] - limit[i]) * (u - static_cast<double>(i));
    distance_at_.push_back(s);
    speed_at_.push_back(speed);
    s += speed * kTimeStep;
  }
}

double Route::distance_travelled(double time) const {
  const double u = std::clamp(time / kTimeStep, 0.0, static_cast<double>(distance_at_.size() - 1) - 1e-9);
  const auto i = static_cast<std::size_t>(u);
  const double t = u - static_cast<double>(i);
  // Cubic Hermite: distance and speed are both continuous.
  const double d0 = distance_at_[i];
  const double d1 = distance_at_[i + 1];
  const double v0 = speed_at_[i] * kTimeStep;
  const double v1 = speed_at_[i + 1] * kTimeStep;
  return d0 + t * (v0 + t * (3.0 * (d1 - d0) - 2.0 * v0 - v1 + t * (2.0 * (d0 - d1) + v0 + v1)));
}

Pose Route::pose_at(double time) const {
  const Curve curve = catmull_rom(points_, distance_travelled(time) / kPointStep);
  const Eigen::Vector2d ahead = curve.derivative.normalized();
  const Eigen::Vector3d ground = ground_.at(curve.position.x(), curve.position.y());
  const double climb = ground[1] * ahead.x() + ground[2] * ahead.y();
  const double tilt = -ground[1] * ahead.y() + ground[2] * ahead.x();
  const double roll = std::atan(tilt) + options_.sway_rad * std::sin(2.0 * M_PI * 0.41 * time + 0.7);
  const double pitch = -std::atan(climb) + options_.sway_rad * std::sin(2.0 * M_PI * 0.57 * time);
  const Eigen::Quaterniond q = Eigen::AngleAxisd(std::atan2(ahead.y(), ahead.x()), Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
  return {q, {curve.position.x(), curve.position.y(), ground[0] + options_.sensor_height_m}};
}

}  // namespace hp2
