#include "player/sweep/sweep_reading.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>

namespace hp2 {
namespace {

constexpr double kTurn = 2.0 * M_PI;
constexpr double kMostRingGap_rad = 0.35;  // from a ring's last point to the next one's first

double wrapped(double angle) { return angle - kTurn * std::round(angle / kTurn); }

/// The points of a scan that have a direction, in their order.
struct Directions {
  std::vector<double> azimuth_rad, elevation_rad;
};

Directions directions_of(const Scan& scan) {
  Directions d;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const double x = scan.x[i], y = scan.y[i], z = scan.z[i], r = std::hypot(x, y);
    if (!(r > 0.1 && std::isfinite(r) && std::isfinite(z))) continue;
    d.azimuth_rad.push_back(std::atan2(y, x));
    d.elevation_rad.push_back(std::atan2(z, r));
  }
  return d;
}

/// How far directions that follow one another go round.
struct Rounds {
  double turned_rad = 0.0;  ///< Sum of the steps; positive: counterclockwise.
  double forth_rad = 0.0;   ///< Of the steps in the direction of the sum alone.
};

Rounds rounds_of(const std::vector<double>& azimuth_rad) {
  double left = 0.0, right = 0.0;
  for (std::size_t i = 1; i < azimuth_rad.size(); ++i) {
    const double step = wrapped(azimuth_rad[i] - azimuth_rad[i - 1]);
    (step > 0.0 ? left : right) += std::abs(step);
  }
  return {left - right, std::max(left, right)};
}

/// Mean directions of blocks of points: the beams of one column do not look the same way.
std::vector<double> smoothed(const std::vector<double>& azimuth_rad) {
  constexpr std::size_t kBlocks = 180;
  std::vector<double> means;
  for (std::size_t b = 0; b < kBlocks; ++b) {
    double c = 0.0, s = 0.0;
    for (std::size_t i = b * azimuth_rad.size() / kBlocks; i < (b + 1) * azimuth_rad.size() / kBlocks; ++i) {
      c += std::cos(azimuth_rad[i]);
      s += std::sin(azimuth_rad[i]);
    }
    means.push_back(std::atan2(s, c));
  }
  return means;
}

/// Azimuths at which one ring ends and the next one begins: there the elevation changes for good.
void find_ring_ends(const Directions& d, std::vector<double>& ends_rad) {
  constexpr std::size_t kSide = 8;
  const double least = 0.1 * M_PI / 180.0;
  const auto& e = d.elevation_rad;
  for (std::size_t i = kSide; i + kSide <= e.size(); ++i) {
    if (std::abs(e[i] - e[i - 1]) < least) continue;
    const auto before = std::minmax_element(e.begin() + static_cast<std::ptrdiff_t>(i - kSide),
                                            e.begin() + static_cast<std::ptrdiff_t>(i));
    const auto after = std::minmax_element(e.begin() + static_cast<std::ptrdiff_t>(i),
                                           e.begin() + static_cast<std::ptrdiff_t>(i + kSide));
    const double spread = std::max(*before.second - *before.first, *after.second - *after.first);
    const double apart = std::max(*after.first - *before.second, *before.first - *after.second);
    const double gap = wrapped(d.azimuth_rad[i] - d.azimuth_rad[i - 1]);
    if (apart > std::max(least, 2.0 * spread) && std::abs(gap) < kMostRingGap_rad)
      ends_rad.push_back(d.azimuth_rad[i - 1] + 0.5 * gap);
  }
}

/// The direction near which most of `angles` lie, if most of them lie near one.
std::optional<double> common_angle(const std::vector<double>& angles_rad) {
  constexpr double kNear_rad = 0.1;
  std::size_t most = 0;
  double c = 0.0, s = 0.0;
  for (const double candidate : angles_rad) {
    std::size_t n = 0;
    double cn = 0.0, sn = 0.0;
    for (const double a : angles_rad) {
      if (std::abs(wrapped(a - candidate)) > kNear_rad) continue;
      ++n;
      cn += std::cos(a);
      sn += std::sin(a);
    }
    if (n <= most) continue;
    most = n;
    c = cn;
    s = sn;
  }
  if (most < 3 || 2 * most < angles_rad.size()) return std::nullopt;
  return std::atan2(s, c);
}

}  // namespace

float time_of_azimuth(const SweepReading& reading, float azimuth_rad) {
  const auto cut = static_cast<float>(reading.cut_rad);
  const float turned =
      (reading.clockwise ? cut - azimuth_rad : azimuth_rad - cut) / static_cast<float>(kTurn);
  const float s = turned - std::floor(turned);
  return s >= 0.0F && s <= 1.0F ? s : 0.0F;  // points that are no numbers are dropped later
}

void apply_reading(const SweepReading& reading, Scan& scan) {
  switch (reading.kind) {
    case SweepReading::Kind::kGiven:
      return;
    case SweepReading::Kind::kCompensated:
      scan.time.clear();
      return;
    case SweepReading::Kind::kReversed:
      for (float& t : scan.time) t = 1.0F - t;
      return;
    case SweepReading::Kind::kAzimuth:
      scan.time.resize(scan.size());
      for (std::size_t i = 0; i < scan.size(); ++i)
        scan.time[i] = time_of_azimuth(reading, std::atan2(scan.y[i], scan.x[i]));
      return;
  }
}

std::string to_text(const SweepReading& reading) {
  switch (reading.kind) {
    case SweepReading::Kind::kGiven:
      return "times as given";
    case SweepReading::Kind::kCompensated:
      return "motion-compensated";
    case SweepReading::Kind::kReversed:
      return "times reversed";
    case SweepReading::Kind::kAzimuth:
      break;
  }
  double degrees = std::round(wrapped(reading.cut_rad) * 180.0 / M_PI);
  if (degrees <= -180.0) degrees += 360.0;
  return fmt::format("distorted, turning {} from azimuth {:.0f} degrees",
                     reading.clockwise ? "clockwise" : "counterclockwise", degrees);
}

PointOrder order_of_points(const std::vector<const Scan*>& scans) {
  PointOrder order;
  std::size_t once = 0, often = 0, clockwise = 0;
  std::vector<double> seams, ring_ends, beginnings;
  for (const Scan* scan : scans) {
    const Directions d = directions_of(*scan);
    if (d.azimuth_rad.size() < 1000) continue;
    const Rounds columns = rounds_of(smoothed(d.azimuth_rad)), points = rounds_of(d.azimuth_rad);
    const double turned = std::abs(columns.turned_rad);
    if (turned > 0.85 * kTurn && turned < 1.15 * kTurn && turned > 0.9 * columns.forth_rad) {
      ++once;
      if (columns.turned_rad < 0.0) ++clockwise;
      // Several columns, since few beams of one may have a return.
      const std::vector<double> means = smoothed(d.azimuth_rad);
      seams.push_back(means.back() + 0.5 * wrapped(means.front() - means.back()));
    } else if (std::abs(points.turned_rad) > 2.5 * kTurn &&
               std::abs(points.turned_rad) > 0.5 * points.forth_rad) {
      ++often;
      if (points.turned_rad < 0.0) ++clockwise;
      find_ring_ends(d, ring_ends);
      // The first ring may see nothing where it begins; where the last one ends there, too, both do.
      const double gap = wrapped(d.azimuth_rad.front() - d.azimuth_rad.back());
      if (std::abs(gap) < kMostRingGap_rad) beginnings.push_back(d.azimuth_rad.back() + 0.5 * gap);
    }
  }
  const auto most = [&](std::size_t n) { return n > 0 && 5 * n >= 4 * scans.size(); };
  order.spins = most(once) || most(often);
  if (!order.spins) return order;
  order.one_turn = most(once);
  order.clockwise = 2 * clockwise > std::max(once, often);
  auto cut = common_angle(order.one_turn ? seams : ring_ends);
  if (!cut) cut = common_angle(beginnings);
  order.has_cut = cut.has_value();
  order.cut_rad = cut.value_or(0.0);
  return order;
}

}  // namespace hp2
