#include "player/sweep/clock.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "player/readers/file_io.hpp"

namespace hp2 {
namespace {

double median(std::vector<double> v) {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

struct Span {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  bool finite = true;
};

Span span_of(const std::vector<double>& values) {
  Span span;
  for (const double v : values) {
    if (!std::isfinite(v)) {
      span.finite = false;
      continue;
    }
    span.low = std::min(span.low, v);
    span.high = std::max(span.high, v);
  }
  if (span.high < span.low) span.finite = false;
  return span;
}

}  // namespace

std::vector<double> read_times(const std::string& path) {
  const std::string text = read_text(path);
  std::vector<double> times;
  for (const std::string_view line : split_lines(text)) {
    const std::vector<double> numbers = parse_numbers(line);
    if (!numbers.empty()) times.push_back(numbers[0]);
  }
  return times;
}

std::vector<std::int64_t> make_stamps(const std::vector<double>& times_s, std::size_t n,
                                      const std::string& what, std::vector<std::string>& warnings) {
  std::vector<std::int64_t> stamps;
  std::string complaint;
  if (times_s.empty()) complaint = "no times";
  for (std::size_t i = 0; i < std::min(n, times_s.size()) && complaint.empty(); ++i) {
    // Half of what 64 bits hold: differences of stamps must fit, too.
    if (!std::isfinite(times_s[i]) || std::abs(times_s[i]) > 4e12) {
      complaint = "a time that is not finite, for scan " + std::to_string(i);
      break;
    }
    const auto stamp = static_cast<std::int64_t>(std::llround(times_s[i] * 1e6));
    if (!stamps.empty() && stamp <= stamps.back())
      complaint = "times that do not rise, at scan " + std::to_string(i);
    stamps.push_back(stamp);
  }
  if (!complaint.empty()) {
    warnings.push_back(what + " has " + complaint + ": assuming 10 scans a second");
    stamps.clear();
    for (std::size_t i = 0; i < n; ++i) stamps.push_back(static_cast<std::int64_t>(i) * kAssumedSweep_us);
    return stamps;
  }
  if (stamps.size() < n) {
    std::vector<double> steps;
    for (std::size_t i = 1; i < stamps.size(); ++i)
      steps.push_back(static_cast<double>(stamps[i] - stamps[i - 1]));
    const std::int64_t step = steps.empty() ? kAssumedSweep_us : static_cast<std::int64_t>(median(steps));
    warnings.push_back(what + " has " + std::to_string(stamps.size()) + " times for " + std::to_string(n) +
                       " scans: the rest is continued evenly");
    while (stamps.size() < n) stamps.push_back(stamps.back() + step);
  }
  return stamps;
}

std::int64_t estimate_sweep(const std::vector<std::int64_t>& stamps) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const auto step = static_cast<double>(stamps[i] - stamps[i - 1]);
    if (step > 0) steps.push_back(step);
  }
  if (steps.empty()) return kAssumedSweep_us;
  std::sort(steps.begin(), steps.end());
  const double shortest = steps[steps.size() / 10];
  // Steps of two sweeps and more are gaps; the median of the others is not pulled down by jitter as
  // `shortest` is.
  steps.erase(std::upper_bound(steps.begin(), steps.end(), 1.5 * shortest), steps.end());
  const double typical = median(steps);
  return typical > 210'000.0 ? kAssumedSweep_us : static_cast<std::int64_t>(typical);
}

TimeUnit find_time_unit(const std::vector<std::vector<double>>& samples, std::int64_t step_us,
                        double known_unit_s) {
  std::vector<double> spans;
  std::vector<double> lows;
  bool in_unit_interval = true;
  for (const auto& sample : samples) {
    const Span s = span_of(sample);
    if (!s.finite || !(s.high > s.low)) continue;
    spans.push_back(s.high - s.low);
    lows.push_back(s.low);
    in_unit_interval = in_unit_interval && s.low >= -1e-3 && s.high <= 1.001;
  }
  TimeUnit result;
  result.duration_us = step_us;
  if (spans.empty()) return result;
  const double span = median(spans);  // one damaged scan must not set the measure
  const double step_s = static_cast<double>(step_us) * 1e-6;
  const auto fits = [&](double low, double high) {
    for (const double unit : {1.0, 1e-3, 1e-6, 1e-9})
      if (span * unit >= low * step_s && span * unit <= high * step_s) return unit;
    return 0.0;
  };
  if (known_unit_s > 0.0 && span * known_unit_s < 10.0) result.unit_s = known_unit_s;
  if (result.unit_s == 0.0) result.unit_s = fits(0.3, 1.3);
  if (result.unit_s == 0.0 && in_unit_interval && span > 0.5) {
    result.normalised = true;
    return result;
  }
  // A sweep much shorter than the step between scans: scans were left out, or the sensor looks ahead only.
  if (result.unit_s == 0.0) result.unit_s = fits(0.0013, 0.3);
  if (result.unit_s > 0.0) {
    result.duration_us = std::max<std::int64_t>(std::llround(span * result.unit_s * 1e6), 1);
    const double low = median(lows) * result.unit_s * 1e6;
    if (low < 0.0 && low > -2.0 * static_cast<double>(result.duration_us))
      result.start_us = std::llround(low);
  }
  return result;
}

void apply_times(const std::vector<double>& raw, const TimeUnit& unit, Scan& scan) {
  scan.time.clear();
  if (raw.size() != scan.size()) return;
  const Span span = span_of(raw);
  if (!span.finite || !(span.high > span.low)) return;
  double offset = 0.0;
  double scale = 1.0;
  if (!unit.normalised) {
    const double duration =
        unit.unit_s > 0.0 ? static_cast<double>(unit.duration_us) * 1e-6 / unit.unit_s : span.high - span.low;
    // Times within a sweep begin near the drive's usual start; anything else counts from another zero.
    offset = unit.unit_s > 0.0 ? static_cast<double>(unit.start_us) * 1e-6 / unit.unit_s : span.low;
    if (span.low < offset - 0.5 * duration || span.high > offset + 1.5 * duration) offset = span.low;
    scale = 1.0 / duration;
  }
  scan.time.resize(raw.size());
  for (std::size_t i = 0; i < raw.size(); ++i)
    scan.time[i] = static_cast<float>(std::clamp((raw[i] - offset) * scale, 0.0, 1.0));
}

}  // namespace hp2
