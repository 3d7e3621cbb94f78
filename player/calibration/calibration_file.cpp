#include "player/calibration/calibration_file.hpp"

#include <cmath>

#include <fmt/format.h>

#include "common/atomic_file.hpp"

namespace hp2 {
namespace {

double rounded(double value) { return std::round(1e4 * value) / 1e4 + 0.0; }

std::string known(bool is_known, double value, double deviation, const char* format) {
  const std::string numbers = fmt::format(fmt::runtime(format), value, deviation);
  return is_known ? numbers : "(" + numbers + ")";
}

}  // namespace

std::string describe(const CalibrationEstimate& e, const std::vector<double>& rings) {
  std::string text = fmt::format(
      "vertical angles, true minus given: {:+.4f} deg, standard deviation {:.4f} deg\n"
      "from {} planes in {} stretches; points lie {:.1f} mm off their planes in the median, {:.1f} mm "
      "before\n",
      e.bias_deg, e.bias_sd_deg, e.patches, e.windows, 1e3 * e.thickness_after_m, 1e3 * e.thickness_before_m);
  if (rings.empty()) return text;
  text +=
      "ring  given deg  points  true minus given deg, sd  measured minus true mm, sd  (in brackets: not "
      "determined)\n";
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const RingEstimate& ring = e.rings[r];
    text += fmt::format("{:4} {:10.3f} {:7}  {:>24}  {:>26}\n", r, rings[r], ring.points,
                        known(ring.angle_known, ring.angle_deg, ring.angle_sd_deg, "{:+.4f} {:.4f}"),
                        known(ring.range_known, 1e3 * ring.range_m, 1e3 * ring.range_sd_m, "{:+.1f} {:.1f}"));
  }
  return text;
}

SensorCalibration make_calibration(const CalibrationEstimate& e, const std::vector<double>& rings) {
  SensorCalibration c;
  c.vertical_angle_bias_deg = rounded(e.bias_deg);
  for (std::size_t r = 0; r < rings.size(); ++r) {
    const RingEstimate& ring = e.rings[r];
    c.ring_angles_deg.push_back(rounded(rings[r]));
    c.ring_angle_offsets_deg.push_back(ring.angle_known ? rounded(ring.angle_deg - e.bias_deg) : 0.0);
    c.ring_range_offsets_m.push_back(ring.range_known ? rounded(ring.range_m) : 0.0);
  }
  return c;
}

void write_calibration(const std::string& path, const CalibrationEstimate& estimate,
                       const std::vector<double>& rings, const std::string& drive) {
  SensorCalibration calibration = make_calibration(estimate, rings);
  Config config;
  config.add(sensor_section(calibration));
  std::string comment = "Estimated by hp2_calibrate from " + drive + "\n" + describe(estimate, rings);
  std::string text;
  for (std::size_t at = 0; at < comment.size();) {
    const std::size_t end = comment.find('\n', at);
    text += "# " + comment.substr(at, end - at) + "\n";
    at = end + 1;
  }
  write_file(path, text + config.print());
}

}  // namespace hp2
