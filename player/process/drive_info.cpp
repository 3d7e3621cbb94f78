#include "player/process/drive_info.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include <fmt/format.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMostRead = 200;
constexpr std::size_t kMostNamed = 10;

double quantile(std::vector<double> v, double q) {
  if (v.empty()) return 0.0;
  const auto at = v.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(v.size() - 1));
  std::nth_element(v.begin(), at, v.end());
  return *at;
}

/// Figures of the scans that were read.
struct Seen {
  std::vector<double> points, ranges, elevations_deg, durations_s;
  std::set<int> azimuths;  ///< Of 10 degrees each.
  std::set<long> rows;     ///< Elevations in steps of 0.25 degrees that hold many points.
  std::size_t read = 0, empty = 0, with_time = 0, with_intensity = 0;
  double turn = 0.0;  ///< Mean sign of the azimuth's change with time.
  std::vector<std::string> errors;
};

/// +1: anticlockwise from above, -1: clockwise; near 0: neither. From points that follow one another in time.
double sense_of_turn(const Scan& scan) {
  std::vector<std::pair<float, double>> by_time;
  for (std::size_t i = 0; i < scan.size(); i += std::max<std::size_t>(1, scan.size() / 2000))
    if (std::hypot(scan.x[i], scan.y[i]) > 0.5F)
      by_time.emplace_back(scan.time[i], std::atan2(scan.y[i], scan.x[i]));
  std::sort(by_time.begin(), by_time.end());
  double sum = 0.0, n = 0.0;
  for (std::size_t i = 20; i < by_time.size(); ++i) {
    const double turned = std::remainder(by_time[i].second - by_time[i - 20].second, 2.0 * M_PI);
    if (turned != 0.0) sum += turned > 0.0 ? 1.0 : -1.0, n += 1.0;
  }
  return n > 0.0 ? sum / n : 0.0;
}

void look_at(const Scan& scan, Seen& seen) {
  ++seen.read;
  seen.empty += scan.size() == 0 ? 1 : 0;
  if (scan.size() == 0) return;
  seen.points.push_back(static_cast<double>(scan.size()));
  seen.with_intensity += scan.intensity.size() == scan.size() ? 1 : 0;
  std::vector<std::size_t> rows(721, 0);
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const double h = std::hypot(scan.x[i], scan.y[i]), range = std::hypot(h, scan.z[i]);
    if (!std::isfinite(range) || range < 0.1) continue;
    const double elevation = std::atan2(static_cast<double>(scan.z[i]), h) * 180.0 / M_PI;
    ++rows[static_cast<std::size_t>((elevation + 90.0) * 4.0)];
    seen.azimuths.insert(static_cast<int>(std::floor(std::atan2(scan.y[i], scan.x[i]) * 18.0 / M_PI)));
    if (i % 16 != 0) continue;
    seen.ranges.push_back(range);
    seen.elevations_deg.push_back(elevation);
  }
  const std::size_t many = *std::max_element(rows.begin(), rows.end()) / 5;
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (rows[r] > many) seen.rows.insert(static_cast<long>(r));
  if (scan.time.size() != scan.size()) return;
  ++seen.with_time;
  seen.durations_s.push_back(static_cast<double>(scan.duration_us) * 1e-6);
  seen.turn += sense_of_turn(scan);
}

Seen read_some(const ScanSource& source) {
  Seen seen;
  const std::size_t n = std::min(source.size(), kMostRead);
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = n < 2 ? 0 : k * (source.size() - 1) / (n - 1);
    try {
      look_at(source.read(i), seen);
    } catch (const Error& error) {
      seen.errors.push_back(fmt::format("scan {} cannot be read: {}", i, error.what()));
    }
  }
  for (const std::string& text : source.damaged()) seen.errors.push_back(text);
  return seen;
}

std::string describe_clock(const ScanSource& source) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < source.size(); ++i) {
    const auto a = source.utime_end(i - 1), b = source.utime_end(i);
    if (a && b) steps.push_back(static_cast<double>(*b - *a) * 1e-6);
  }
  if (steps.empty()) return "rate: not known\n";
  const double usual = quantile(steps, 0.5);
  std::string text =
      fmt::format("rate: {:.3g} Hz (a scan every {:.4g} s)\n", 1.0 / std::max(usual, 1e-6), usual);
  const auto gaps = std::count_if(steps.begin(), steps.end(), [&](double s) { return s > 1.75 * usual; });
  const auto longest = std::max_element(steps.begin(), steps.end());
  text += gaps == 0 ? "gaps: none\n"
                    : fmt::format("gaps: {}, the longest {:.3g} s after scan {}\n", gaps, *longest,
                                  longest - steps.begin());
  return text;
}

std::string describe_scans(const ScanSource& source, const Seen& seen) {
  std::string text = fmt::format("points: {:.0f} per scan ({:.0f} to {:.0f})", quantile(seen.points, 0.5),
                                 quantile(seen.points, 0.0), quantile(seen.points, 1.0));
  if (seen.empty > 0) text += fmt::format(", {} of {} scans are empty", seen.empty, seen.read);
  text += fmt::format("\nfields: x y z{}{}\n", seen.with_intensity > 0 ? " intensity" : "",
                      seen.with_time > 0 ? " time" : "");
  const double view = 10.0 * static_cast<double>(seen.azimuths.size());
  text += fmt::format(
      "sensor: {}{:.0f} degrees around, {:.0f} to {:.0f} degrees up, {} elevations, ranges to {:.0f} m (half "
      "within "
      "{:.0f} m)\n",
      source.info().sensor.empty() ? "" : source.info().sensor + ", ", view,
      quantile(seen.elevations_deg, 0.005), quantile(seen.elevations_deg, 0.995),
      seen.rows.size() > 150 ? "many" : fmt::format("about {}", seen.rows.size()),
      quantile(seen.ranges, 0.999), quantile(seen.ranges, 0.5));
  if (seen.with_time == 0) return text + "time in the sweep: none\n";
  const std::string unit = source.time_in_sweep();
  text += fmt::format("time in the sweep: {}, {:.4g} s per sweep\n", unit.empty() ? "given" : unit,
                      quantile(seen.durations_s, 0.5));
  const double turn = seen.turn / static_cast<double>(seen.with_time);
  text += fmt::format("sweep direction: {}\n", turn > 0.6    ? "anticlockwise from above"
                                               : turn < -0.6 ? "clockwise from above"
                                                             : "neither clockwise nor anticlockwise");
  return text;
}

}  // namespace

std::string describe_drive(const ScanSource& source) {
  const Seen seen = read_some(source);
  std::string text = fmt::format("{}: {}, {} scans{}\n", source.info().name, source.info().format,
                                 source.size(), source.ground_truth().empty() ? "" : ", with ground truth");
  text += describe_clock(source);
  if (!seen.points.empty()) text += describe_scans(source, seen);
  text += source.ground_truth().empty() ? "ground truth: none\n"
                                        : fmt::format("ground truth: for {} of {} scans\n",
                                                      source.ground_truth().size(), source.size());
  if (seen.read < source.size())
    text +=
        fmt::format("({} of {} scans were read for this)\n", seen.read + seen.errors.size(), source.size());
  for (const std::string& warning : source.warnings()) text += "remark: " + warning + "\n";
  for (std::size_t i = 0; i < std::min(seen.errors.size(), kMostNamed); ++i)
    text += "damaged: " + seen.errors[i] + "\n";
  if (seen.errors.size() > kMostNamed)
    text += fmt::format("damaged: {} more\n", seen.errors.size() - kMostNamed);
  if (!seen.errors.empty())
    text += "A run stops at the first damaged scan; with --skip-damaged it leaves such scans out.\n";
  return text;
}

}  // namespace hp2
