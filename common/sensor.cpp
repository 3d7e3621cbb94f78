#include "common/sensor.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kLargestAngle_deg = 5.0;
constexpr double kLargestRange_m = 1.0;
constexpr double kRingWidth = 0.35;  // of the gap to the next ring, on each side
constexpr std::size_t kMostRings = 1024;

const char* const kSection = "configuration, section \"sensor\"";

void check_length(const std::vector<double>& values, const std::string& key, std::size_t rings) {
  if (values.empty() || values.size() == rings) return;
  throw Error(key + " has " + std::to_string(values.size()) + " values, but ring_angles_deg has " +
                  std::to_string(rings),
              kSection, "Give one per ring, or none.");
}

/// Turns (x, y, z) up by the angle of cosine c and sine s; nothing without a horizontal axis to turn about.
template <class T>
void turn_up(T& x, T& y, T& z, T c, T s) {
  const T horizontal = std::sqrt(x * x + y * y);
  if (!(horizontal > T(0))) return;
  const T scale = c - s * z / horizontal;
  x *= scale;
  y *= scale;
  z = z * c + horizontal * s;
}

}  // namespace

ConfigSection sensor_section(SensorCalibration& c) {
  ConfigSection s("sensor");
  s.add("vertical_angle_bias_deg", c.vertical_angle_bias_deg,
        "True minus given vertical angle of all points [deg]", -kLargestAngle_deg, kLargestAngle_deg);
  s.add("ring_angles_deg", c.ring_angles_deg,
        "Vertical angle of each ring as the driver gives it [deg], by which a point's ring is told", -90.0,
        90.0);
  s.add("ring_angle_offsets_deg", c.ring_angle_offsets_deg,
        "True minus given vertical angle of each ring, on top of the bias [deg]", -kLargestAngle_deg,
        kLargestAngle_deg);
  s.add("ring_range_offsets_m", c.ring_range_offsets_m, "Measured minus true range of each ring [m]",
        -kLargestRange_m, kLargestRange_m);
  return s;
}

bool corrects_scans(const SensorCalibration& c) {
  const auto any = [](const std::vector<double>& values) {
    return std::any_of(values.begin(), values.end(), [](double v) { return v != 0.0; });
  };
  return c.vertical_angle_bias_deg != 0.0 || any(c.ring_angle_offsets_deg) || any(c.ring_range_offsets_m);
}

void validate(const SensorCalibration& c) {
  if (c.ring_angles_deg.size() > kMostRings)
    throw Error("ring_angles_deg has more than " + std::to_string(kMostRings) + " rings", kSection,
                "Give one angle per ring of the sensor.");
  check_length(c.ring_angle_offsets_deg, "ring_angle_offsets_deg", c.ring_angles_deg.size());
  check_length(c.ring_range_offsets_m, "ring_range_offsets_m", c.ring_angles_deg.size());
  std::vector<double> angles = c.ring_angles_deg;
  std::sort(angles.begin(), angles.end());
  if (std::adjacent_find(angles.begin(), angles.end()) != angles.end())
    throw Error("ring_angles_deg has an angle twice", kSection,
                "Rings are told by their angles: give each ring its own.");
}

void raise_vertical_angles(Scan& scan, double angle_rad) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  for (std::size_t i = 0; i < scan.size(); ++i) {
    double x = scan.x[i], y = scan.y[i], z = scan.z[i];
    turn_up(x, y, z, c, s);
    scan.x[i] = static_cast<float>(x);
    scan.y[i] = static_cast<float>(y);
    scan.z[i] = static_cast<float>(z);
  }
}

RingTable::RingTable(const std::vector<double>& angles_deg) : cells_(kCells, kNone) {
  const std::vector<double>& angles = angles_deg;
  std::vector<std::size_t> order(angles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return angles[a] < angles[b]; });
  constexpr double kLoneGap_deg = 2.0;
  for (std::size_t k = 0; k < order.size(); ++k) {
    const double angle = angles[order[k]];
    double gap = order.size() == 1 ? kLoneGap_deg : 180.0;
    if (k > 0) gap = std::min(gap, angle - angles[order[k - 1]]);
    if (k + 1 < order.size()) gap = std::min(gap, angles[order[k + 1]] - angle);
    const auto cell = [](double degrees) {
      const double sine = std::sin(std::clamp(degrees, -90.0, 90.0) * kDegree);
      return static_cast<std::size_t>(std::lround((sine + 1.0) * (0.5 * (kCells - 1))));
    };
    const std::size_t begin = cell(angle - kRingWidth * gap), end = cell(angle + kRingWidth * gap);
    for (std::size_t i = begin; i <= end; ++i) cells_[i] = static_cast<std::int16_t>(order[k]);
  }
}

SensorCorrection::SensorCorrection(const SensorCalibration& calibration)
    : corrects_(corrects_scans(calibration)),
      has_rings_(!calibration.ring_angles_deg.empty()),
      table_(calibration.ring_angles_deg) {
  validate(calibration);
  const auto ring = [&](double angle_deg, double range_m) {
    return Ring{static_cast<float>(std::cos(angle_deg * kDegree)),
                static_cast<float>(std::sin(angle_deg * kDegree)), static_cast<float>(range_m)};
  };
  const auto value = [](const std::vector<double>& values, std::size_t i) {
    return values.empty() ? 0.0 : values[i];
  };
  const double bias = calibration.vertical_angle_bias_deg;
  rings_.push_back(ring(bias, 0.0));
  for (std::size_t i = 0; i < calibration.ring_angles_deg.size(); ++i)
    rings_.push_back(ring(bias + value(calibration.ring_angle_offsets_deg, i),
                          value(calibration.ring_range_offsets_m, i)));
}

double SensorCorrection::apply(Scan& scan) const {
  std::size_t finite = 0, on_ring = 0;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    float x = scan.x[i], y = scan.y[i], z = scan.z[i];
    const float range = std::sqrt(x * x + y * y + z * z);
    if (!(range > 0.0F && range < std::numeric_limits<float>::infinity())) continue;
    const std::int16_t number = table_.ring(std::clamp(z / range, -1.0F, 1.0F));
    ++finite;
    on_ring += number >= 0 ? 1 : 0;
    const Ring& ring = rings_[static_cast<std::size_t>(number + 1)];
    turn_up(x, y, z, ring.cosine, ring.sine);
    const float scale = std::max(range - ring.range_offset_m, 0.0F) / range;
    scan.x[i] = x * scale;
    scan.y[i] = y * scale;
    scan.z[i] = z * scale;
  }
  if (!has_rings_ || finite == 0) return 1.0;
  return static_cast<double>(on_ring) / static_cast<double>(finite);
}

}  // namespace hp2
