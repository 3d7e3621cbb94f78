#include "player/sweep/drive_shape.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMostSampled = 3;    // scans to find the unit from
constexpr std::size_t kMostLookedAt = 12;  // scans among which these are sought: some may be empty or damaged
constexpr double kLongestRange_m = 500.0;  // half of a sensor's points never lie beyond it
constexpr double kCoarsest_m = 30.0;       // no sensor rounds to whole metres
constexpr std::size_t kBins = 72;          // of azimuth
constexpr std::size_t kMostParts = 72;     // of a sweep

double median(std::vector<double> v) {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

/// Reads scan i; an empty scan if it is damaged, which is reported when it is its turn.
Scan read_scan(const Drive& drive, std::size_t i) {
  Scan scan;
  try {
    scan.utime = drive.scans[i].utime;
    scan.duration_us = drive.scans[i].duration_us;
    drive.decode(drive.scans[i], scan);
  } catch (const Error&) {
    return {};
  }
  return scan;
}

struct Lengths {
  double median_range = 0.0;  ///< In the file's unit; 0: no points.
  bool whole = true;          ///< All coordinates are whole numbers.
};

Lengths measure_lengths(const Drive& drive) {
  Lengths lengths;
  std::vector<double> medians;
  for (std::size_t i = 0; i < std::min(drive.scans.size(), kMostLookedAt) && medians.size() < kMostSampled;
       ++i) {
    const Scan scan = read_scan(drive, i);
    std::vector<double> ranges;
    for (std::size_t k = 0; k < scan.size(); ++k) {
      const double x = scan.x[k], y = scan.y[k], z = scan.z[k];
      const double range = std::sqrt(x * x + y * y + z * z);
      if (!std::isfinite(range) || range == 0.0) continue;
      ranges.push_back(range);
      lengths.whole = lengths.whole && x == std::floor(x) && y == std::floor(y) && z == std::floor(z);
    }
    if (!ranges.empty()) medians.push_back(median(std::move(ranges)));
  }
  std::sort(medians.begin(), medians.end());
  if (!medians.empty())
    lengths.median_range = medians[(medians.size() - 1) / 2];  // one odd scan is no evidence
  return lengths;
}

double metres_of(const std::string& unit) {
  if (unit == "m") return 1.0;
  if (unit == "cm") return 0.01;
  if (unit == "mm") return 0.001;
  throw Error("unknown unit of length '" + unit + "'", "--points-unit", "Known are m, cm and mm.");
}

/// A part's place in the sweep.
struct Part {
  double azimuth_deg = 0.0;  ///< Mean.
  double width_deg = 0.0;
  bool good = false;  ///< It has points in one direction.
};

Part look_at(const Scan& scan) {
  std::array<std::size_t, kBins> bins{};
  double x = 0.0, y = 0.0, n = 0.0;
  for (std::size_t k = 0; k < scan.size(); ++k) {
    const double range = std::hypot(scan.x[k], scan.y[k]);
    if (!(range > 0.3) || !std::isfinite(range)) continue;
    x += scan.x[k] / range;
    y += scan.y[k] / range;
    n += 1.0;
    const double turn = (std::atan2(scan.y[k], scan.x[k]) + M_PI) / (2.0 * M_PI);
    ++bins[std::min(kBins - 1, static_cast<std::size_t>(turn * static_cast<double>(kBins)))];
  }
  Part part;
  if (n < 10.0) return part;
  const auto least = static_cast<std::size_t>(0.002 * n);
  const auto filled = std::count_if(bins.begin(), bins.end(), [&](std::size_t b) { return b > least; });
  part.azimuth_deg = std::atan2(y, x) * 180.0 / M_PI;
  part.width_deg = 360.0 / static_cast<double>(kBins) * static_cast<double>(filled);
  part.good = std::hypot(x, y) > 0.3 * n;
  return part;
}

double wrapped(double degrees) { return degrees - 360.0 * std::round(degrees / 360.0); }

/// Parts that make one turn; 0: the scans are whole, or look into one direction.
double parts_per_turn(const Drive& drive) {
  constexpr double kWhole_deg = 215.0;
  constexpr double kTurns = 2.0;
  std::vector<double> steps, widths;
  double turned = 0.0;
  Part before;
  const std::size_t most = std::min<std::size_t>(drive.scans.size(), 3 * kMostParts);
  for (std::size_t i = 0; i < most && std::abs(turned) < 360.0 * kTurns; ++i) {
    const Part part = look_at(read_scan(drive, i));
    if (part.good && part.width_deg > kWhole_deg) return 0.0;
    if (part.good && before.good) {
      steps.push_back(wrapped(part.azimuth_deg - before.azimuth_deg));
      widths.push_back(part.width_deg);
      turned += steps.back();
    }
    before = part;
    if (i == 5 && std::abs(turned) < 10.0) return 0.0;  // it looks ahead
  }
  if (steps.size() < 4) return 0.0;
  const double step = median(steps);
  const bool halves = std::abs(step) > 150.0;  // their steps wrap to either sign
  if (!halves && std::abs(turned) < 360.0 * kTurns) return 0.0;
  if (std::abs(step) < 360.0 / static_cast<double>(kMostParts)) return 0.0;
  const auto even = std::count_if(steps.begin(), steps.end(), [&](double s) {
    return std::abs(wrapped(s - step)) < 0.5 * std::abs(step);
  });
  if (static_cast<double>(even) < 0.85 * static_cast<double>(steps.size())) return 0.0;
  if (median(widths) > 2.0 * std::abs(step) + 15.0) return 0.0;  // views that overlap are no parts
  const double mean = halves ? 180.0 : std::abs(turned) / static_cast<double>(steps.size());
  const double parts = 360.0 / mean;
  return std::abs(parts - std::round(parts)) < 0.2 ? std::round(parts) : parts;
}

/// The parts of a sweep: `count` scans of the original drive from `first` on.
struct Sweep {
  std::size_t first = 0, count = 0;
};

std::int64_t usual_step(const std::vector<DriveScan>& scans) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < scans.size(); ++i)
    steps.push_back(static_cast<double>(scans[i].utime - scans[i - 1].utime));
  return std::max<std::int64_t>(1, std::llround(median(std::move(steps))));
}

std::vector<Sweep> group(const std::vector<DriveScan>& scans, double parts, std::int64_t step_us) {
  std::vector<Sweep> sweeps;
  double place = 0.0;  // in parts, those that are missing counted
  double turn = -1.0;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    if (i > 0)
      place += std::max(1.0, std::round(static_cast<double>(scans[i].utime - scans[i - 1].utime) /
                                        static_cast<double>(step_us)));
    const double here = std::floor((place + 1e-6) / parts);
    if (sweeps.empty() || here > turn) sweeps.push_back({i, 0});
    turn = here;
    ++sweeps.back().count;
  }
  return sweeps;
}

void append(const std::vector<float>& from, std::vector<float>& to) {
  to.insert(to.end(), from.begin(), from.end());
}

/// Reads the parts of a sweep and puts them together.
void decode_sweep(const std::function<void(const DriveScan&, Scan&)>& decode, const DriveScan* parts,
                  std::size_t count, std::int64_t step_us, Scan& sweep) {
  thread_local Scan part;
  for (auto* values : {&sweep.x, &sweep.y, &sweep.z, &sweep.intensity, &sweep.time}) values->clear();
  const auto length = static_cast<double>(sweep.duration_us);
  const std::int64_t start = parts[0].utime;
  for (std::size_t k = 0; k < count; ++k) {
    part.time.clear();
    part.utime = parts[k].utime;
    part.duration_us = parts[k].duration_us > 0 ? parts[k].duration_us : step_us;
    decode(parts[k], part);
    append(part.x, sweep.x);
    append(part.y, sweep.y);
    append(part.z, sweep.z);
    append(part.intensity, sweep.intensity);
    const bool timed = part.time.size() == part.size();
    for (std::size_t i = 0; i < part.size(); ++i) {
      const double in_part = timed ? part.time[i] : 0.5;
      const double us =
          static_cast<double>(part.utime - start) + in_part * static_cast<double>(part.duration_us);
      sweep.time.push_back(static_cast<float>(std::clamp(us / length, 0.0, 1.0)));
    }
  }
  if (sweep.intensity.size() != sweep.x.size()) sweep.intensity.clear();
}

}  // namespace

void settle_length_unit(Drive& drive, const std::string& unit) {
  double scale = unit.empty() ? 1.0 : metres_of(unit);
  if (unit.empty()) {
    const Lengths lengths = measure_lengths(drive);
    const double range = lengths.median_range;
    if (range > 1e3 * kLongestRange_m)
      throw Error(
          fmt::format("the points are no LiDAR's: half of them lie beyond {:.3g} m", range), drive.info.path,
          "The points' layout is another one than was read, or the file is damaged. Name the unit with "
          "--points-unit, or the format with --dataset.");
    if (range > kLongestRange_m || (lengths.whole && range > kCoarsest_m)) {
      scale = 0.001;
      drive.warnings.push_back(fmt::format(
          "the points are read as millimetres: as metres, half of them would lie beyond {:.0f} m{} "
          "(--points-unit m takes them as metres)",
          range, lengths.whole ? " on whole metres" : ""));
    }
  }
  if (scale == 1.0) return;
  const auto factor = static_cast<float>(scale);
  drive.decode = [decode = drive.decode, factor](const DriveScan& entry, Scan& scan) {
    decode(entry, scan);
    for (auto* axis : {&scan.x, &scan.y, &scan.z})
      for (float& v : *axis) v *= factor;
  };
}

void join_parts(Drive& drive) {
  if (drive.scans.size() < 6) return;
  const double parts = parts_per_turn(drive);
  if (parts < 1.5) return;
  const std::int64_t step_us = usual_step(drive.scans);
  std::vector<Sweep> sweeps = group(drive.scans, parts, step_us);
  std::size_t left_out = 0;
  const auto is_small = [&](const Sweep& s) {
    const bool small = 2.0 * static_cast<double>(s.count) < parts;
    left_out += small ? s.count : 0;
    return small;
  };
  sweeps.erase(std::remove_if(sweeps.begin(), sweeps.end(), is_small), sweeps.end());
  if (sweeps.empty()) return;

  const auto all = std::make_shared<const std::vector<DriveScan>>(std::move(drive.scans));
  std::vector<std::optional<Pose>> truth;
  drive.scans.clear();
  for (const Sweep& s : sweeps) {
    const DriveScan& first = (*all)[s.first];
    const DriveScan& last = (*all)[s.first + s.count - 1];
    DriveScan joined = first;
    joined.duration_us = last.utime + (last.duration_us > 0 ? last.duration_us : step_us) - first.utime;
    joined.key = static_cast<std::int64_t>(drive.scans.size());
    drive.scans.push_back(joined);
    if (!drive.ground_truth.empty()) truth.push_back(drive.ground_truth[s.first + s.count - 1]);
  }
  drive.ground_truth = std::move(truth);
  if (drive.time_in_sweep.empty()) drive.time_in_sweep = "the parts' stamps";
  drive.warnings.push_back(fmt::format(
      "each sweep comes in {:.3g} parts of {:.0f} degrees: {} sweeps are put together from {} parts{}", parts,
      360.0 / parts, sweeps.size(), all->size(),
      left_out > 0 ? fmt::format(", {} parts of incomplete sweeps are left out", left_out) : ""));
  drive.decode = [all, sweeps = std::move(sweeps), step_us, decode = drive.decode](const DriveScan& entry,
                                                                                   Scan& scan) {
    const Sweep& s = sweeps[static_cast<std::size_t>(entry.key)];
    decode_sweep(decode, all->data() + s.first, s.count, step_us, scan);
  };
}

}  // namespace hp2
