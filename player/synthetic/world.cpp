#include "player/synthetic/world.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace hp2 {
namespace {

constexpr double kCell = 4.0;     // m
constexpr double kNearest = 0.3;  // m; nothing is seen nearer to the sensor
constexpr std::uint32_t kKindShift = 30;
constexpr std::uint32_t kBox = 0, kCylinder = 1, kCrown = 2;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Waves of the ground: direction (cos, sin), waves a metre, share of the amplitude.
struct Wave {
  double cx, cy, k, share;
};
constexpr Wave kWaves[3] = {
    {0.80, 0.60, 0.0077, 0.5}, {-0.34, 0.94, 0.0113, 0.3}, {0.98, -0.17, 0.0151, 0.2}};

void take(Hit& hit, double range, double cos_incidence, double albedo, bool leaves) {
  hit.range = range;
  hit.cos_incidence = std::abs(cos_incidence);
  hit.albedo = albedo;
  hit.leaves = leaves;
}

Hit finish(Hit hit) {
  if (hit.albedo < 0.0) hit.range = -1.0;
  return hit;
}

}  // namespace

Eigen::Vector3d Ground::at(double x, double y) const {
  Eigen::Vector3d result = Eigen::Vector3d::Zero();
  if (amplitude_m == 0.0) return result;
  for (std::size_t i = 0; i < 3; ++i) {
    const Wave& w = kWaves[i];
    // Arcs of parabolas in place of sines: continuous with their slope, and ten times as quick.
    const double turns = w.k * (w.cx * x + w.cy * y) + phase[i];
    const double u = turns - std::floor(turns) - 0.5;
    const double height = amplitude_m * w.share * 8.0 * u * (2.0 * std::abs(u) - 1.0);
    const double slope = amplitude_m * w.share * 8.0 * w.k * (4.0 * std::abs(u) - 1.0);
    result += Eigen::Vector3d(height, slope * w.cx, slope * w.cy);
  }
  return result;
}

std::vector<World::Bounds> World::bounds() {
  std::vector<Bounds> all;
  turned_.clear();
  for (const Box& b : boxes_) {
    const double c = std::cos(b.yaw);
    const double s = std::sin(b.yaw);
    const double rx = std::abs(c) * b.half_x + std::abs(s) * b.half_y;
    const double ry = std::abs(s) * b.half_x + std::abs(c) * b.half_y;
    const auto id = kBox << kKindShift | static_cast<std::uint32_t>(turned_.size());
    all.push_back({id, b.x - rx, b.y - ry, b.x + rx, b.y + ry, b.z_high});
    turned_.push_back({b, c, s});
  }
  const auto add_round = [&](std::uint32_t kind, std::size_t i, double x, double y, double r, double top) {
    all.push_back({kind << kKindShift | static_cast<std::uint32_t>(i), x - r, y - r, x + r, y + r, top});
  };
  for (std::size_t i = 0; i < cylinders_.size(); ++i)
    add_round(kCylinder, i, cylinders_[i].x, cylinders_[i].y, cylinders_[i].radius, cylinders_[i].z_high);
  for (std::size_t i = 0; i < crowns_.size(); ++i)
    add_round(kCrown, i, crowns_[i].x, crowns_[i].y, crowns_[i].radius, crowns_[i].z + crowns_[i].radius);
  return all;
}

void World::build() {
  const std::vector<Bounds> all = bounds();
  double x1 = 1.0;
  double y1 = 1.0;
  x0_ = y0_ = -1.0;
  for (const Bounds& b : all) {
    x0_ = std::min(x0_, b.x0 - 1.0);
    y0_ = std::min(y0_, b.y0 - 1.0);
    x1 = std::max(x1, b.x1 + 1.0);
    y1 = std::max(y1, b.y1 + 1.0);
  }
  const auto cell = [](double v, double origin) {
    return static_cast<int>(std::floor((v - origin) / kCell));
  };
  nx_ = cell(x1, x0_) + 1;
  ny_ = cell(y1, y0_) + 1;
  std::vector<std::vector<std::uint32_t>> cells(static_cast<std::size_t>(nx_ * ny_));
  top_.assign(cells.size(), -kInfinity);
  for (const Bounds& b : all) {
    for (int iy = cell(b.y0, y0_); iy <= cell(b.y1, y0_); ++iy) {
      for (int ix = cell(b.x0, x0_); ix <= cell(b.x1, x0_); ++ix) {
        const auto k = static_cast<std::size_t>(iy * nx_ + ix);
        cells[k].push_back(b.id);
        top_[k] = std::max(top_[k], b.top);
      }
    }
  }
  start_.assign(1, 0);
  entries_.clear();
  for (const auto& list : cells) {
    entries_.insert(entries_.end(), list.begin(), list.end());
    start_.push_back(static_cast<std::uint32_t>(entries_.size()));
  }
}

void World::cast_ground(const Eigen::Vector3d& o, const Eigen::Vector3d& d, double max_range,
                        Hit& hit) const {
  constexpr double kAlbedo = 0.25;
  // Most rays that look ahead never come down to where there could be ground.
  if (d.z() > -1e-6 || o.z() + max_range * d.z() > ground.amplitude_m) return;
  double t = (ground.height(o.x(), o.y()) - o.z()) / d.z();
  if (ground.amplitude_m > 0.0) {
    for (int i = 0; i < 12; ++i) {
      if (t > 2.0 * max_range) return;
      const double x = o.x() + t * d.x();
      const double y = o.y() + t * d.y();
      const Eigen::Vector3d here = ground.at(x, y);
      const double above = o.z() + t * d.z() - here[0];
      if (std::abs(above) < 1e-4) break;
      if (i == 11) return;
      t -= above / std::min(d.z() - here[1] * d.x() - here[2] * d.y(), -0.004);  // Newton
    }
  }
  if (t > kNearest && t <= max_range) take(hit, t, d.z(), kAlbedo, false);
}

void World::cast_box(const TurnedBox& b, const Eigen::Vector3d& o, const Eigen::Vector3d& d, Hit& hit) const {
  const double px = o.x() - b.box.x;
  const double py = o.y() - b.box.y;
  const double lo[3] = {-b.box.half_x, -b.box.half_y, b.box.z_low};
  const double hi[3] = {b.box.half_x, b.box.half_y, b.box.z_high};
  const double p[3] = {b.c * px + b.s * py, -b.s * px + b.c * py, o.z()};
  const double v[3] = {b.c * d.x() + b.s * d.y(), -b.s * d.x() + b.c * d.y(), d.z()};
  double enter_at = kNearest;
  double leave_at = hit.range;
  int face = -1;
  for (int k = 0; k < 3; ++k) {
    if (std::abs(v[k]) < 1e-12) {
      if (p[k] < lo[k] || p[k] > hi[k]) return;
      continue;
    }
    const double inverse = 1.0 / v[k];
    double a = (lo[k] - p[k]) * inverse;
    double e = (hi[k] - p[k]) * inverse;
    if (a > e) std::swap(a, e);
    if (a > enter_at) {
      enter_at = a;
      face = k;
    }
    leave_at = std::min(leave_at, e);
    if (enter_at >= leave_at) return;
  }
  if (face >= 0) take(hit, enter_at, v[face], b.box.albedo, false);
}

void World::cast_cylinder(const Cylinder& c, const Eigen::Vector3d& o, const Eigen::Vector3d& d,
                          Hit& hit) const {
  const double px = o.x() - c.x;
  const double py = o.y() - c.y;
  const double a = d.x() * d.x() + d.y() * d.y();
  const double b = px * d.x() + py * d.y();
  const double discriminant = b * b - a * (px * px + py * py - c.radius * c.radius);
  if (discriminant <= 0.0 || a < 1e-12) return;
  const double t = (-b - std::sqrt(discriminant)) / a;
  const double z = o.z() + t * d.z();
  if (t < kNearest || t >= hit.range || z < c.z_low || z > c.z_high) return;
  const double normal_x = (px + t * d.x()) / c.radius;
  const double normal_y = (py + t * d.y()) / c.radius;
  take(hit, t, normal_x * d.x() + normal_y * d.y(), c.albedo, false);
}

void World::cast_crown(const Crown& c, const Eigen::Vector3d& o, const Eigen::Vector3d& d, Hit& hit) const {
  const Eigen::Vector3d p = o - Eigen::Vector3d(c.x, c.y, c.z);
  const double b = p.dot(d);
  const double discriminant = b * b - p.squaredNorm() + c.radius * c.radius;
  if (discriminant <= 0.0) return;
  const double t = -b - std::sqrt(discriminant);
  if (t > kNearest && t < hit.range) take(hit, t, (p + t * d).dot(d) / c.radius, c.albedo, true);
}

Hit World::cast(const Eigen::Vector3d& o, const Eigen::Vector3d& d, double max_range) const {
  Hit hit;
  hit.range = max_range;
  hit.albedo = -1.0;  // nothing yet
  cast_ground(o, d, max_range, hit);
  if (d.z() > 1e-9 && (ceiling_m - o.z()) / d.z() < hit.range)
    take(hit, (ceiling_m - o.z()) / d.z(), d.z(), 0.7, false);

  // Walk the grid's cells along the ray (Amanatides and Woo 1987).
  // It begins where the ray comes into the grid: a sensor may stand outside.
  double enter_at = 0.0;
  for (const int k : {0, 1}) {
    const double low = k == 0 ? x0_ : y0_;
    const double size = kCell * (k == 0 ? nx_ : ny_);
    if (o[k] < low && d[k] > 0) enter_at = std::max(enter_at, (low - o[k]) / d[k]);
    if (o[k] > low + size && d[k] < 0) enter_at = std::max(enter_at, (low + size - o[k]) / d[k]);
  }
  if (enter_at > 0.0) enter_at += 1e-9;
  if (enter_at > max_range) return finish(hit);
  int ix = static_cast<int>(std::floor((o.x() + enter_at * d.x() - x0_) / kCell));
  int iy = static_cast<int>(std::floor((o.y() + enter_at * d.y() - y0_) / kCell));
  const int step_x = d.x() > 0 ? 1 : -1;
  const int step_y = d.y() > 0 ? 1 : -1;
  const auto border = [](int i, int step, double origin) {
    return origin + kCell * (i + (step > 0 ? 1 : 0));
  };
  const double delta_x = std::abs(d.x()) > 1e-12 ? kCell / std::abs(d.x()) : kInfinity;
  const double delta_y = std::abs(d.y()) > 1e-12 ? kCell / std::abs(d.y()) : kInfinity;
  double next_x = std::isinf(delta_x) ? kInfinity : (border(ix, step_x, x0_) - o.x()) / d.x();
  double next_y = std::isinf(delta_y) ? kInfinity : (border(iy, step_y, y0_) - o.y()) / d.y();
  while (ix >= 0 && iy >= 0 && ix < nx_ && iy < ny_) {
    const double leave_at = std::min(next_x, next_y);
    const auto k = static_cast<std::size_t>(iy * nx_ + ix);
    const double lowest = o.z() + d.z() * (d.z() < 0 ? std::min(leave_at, hit.range) : enter_at);
    if (lowest <= top_[k]) {
      for (std::uint32_t e = start_[k]; e < start_[k + 1]; ++e) {
        const std::uint32_t index = entries_[e] & ((1U << kKindShift) - 1);
        const std::uint32_t kind = entries_[e] >> kKindShift;
        if (kind == kBox)
          cast_box(turned_[index], o, d, hit);
        else if (kind == kCylinder)
          cast_cylinder(cylinders_[index], o, d, hit);
        else
          cast_crown(crowns_[index], o, d, hit);
      }
    }
    if (hit.range <= leave_at) break;
    enter_at = leave_at;
    if (next_x < next_y) {
      ix += step_x;
      next_x += delta_x;
    } else {
      iy += step_y;
      next_y += delta_y;
    }
  }
  return finish(hit);
}

}  // namespace hp2
