#include "player/sweep/clock.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include "common/error.hpp"
#include "common/time_unit.hpp"

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
  double share = 1.0;  ///< Of the values that it spans.
};

/// Times that lie further from their scan's stamp are of another clock.
constexpr double kSameClock_s = 2.0;

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

/// The span of the values within `reach` of `centre`; those of points without a return are often 0.
Span span_near(const std::vector<double>& values, double centre, double reach) {
  Span span;
  std::size_t inside = 0;
  for (const double v : values) {
    if (!(std::abs(v - centre) <= reach)) continue;
    ++inside;
    span.low = std::min(span.low, v);
    span.high = std::max(span.high, v);
  }
  span.finite = inside > 0;
  span.share = values.empty() ? 0.0 : static_cast<double>(inside) / static_cast<double>(values.size());
  return span;
}

}  // namespace

std::vector<std::int64_t> make_stamps(const std::vector<double>& times_s, std::size_t n,
                                      const std::string& what, std::vector<std::string>& warnings) {
  std::vector<double> times = times_s;
  times.resize(n, std::numeric_limits<double>::quiet_NaN());
  MendOptions options;
  options.may_reorder = false;
  MendedStamps mended = mend_stamps(times, what, options);
  warnings.insert(warnings.end(), mended.warnings.begin(), mended.warnings.end());
  return std::move(mended.stamps_us);
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

namespace {

/// The unit in which times lie near the stamps of their scans; 0 if there is none.
double absolute_unit(const std::vector<std::vector<double>>& samples,
                     const std::vector<std::int64_t>& stamps_us) {
  if (samples.empty() || stamps_us.size() != samples.size()) return 0.0;
  for (const double unit : {1.0, 1e-3, 1e-6, 1e-9}) {
    std::size_t near = 0;
    for (std::size_t k = 0; k < samples.size(); ++k) {
      const double stamp_s = static_cast<double>(stamps_us[k]) * 1e-6;
      if (std::abs(stamp_s) < kSameClock_s * 10.0) continue;  // near zero everything is near
      const Span s = span_near(samples[k], stamp_s / unit, kSameClock_s / unit);
      near += s.high > s.low && s.share > 0.5 ? 1 : 0;
    }
    if (2 * near > samples.size()) return unit;
  }
  return 0.0;
}

/// Spans of the samples that can be used, in raw units, and where they begin after their stamps.
struct Measured {
  std::vector<double> spans, lows;
  /// Whether they count in sweeps, and lie in 0..1.
  bool in_unit_interval() const {
    for (std::size_t k = 0; k < spans.size(); ++k)
      if (lows[k] < -1e-3 || lows[k] + spans[k] > 1.001) return false;
    return true;
  }
};

Measured measure(const std::vector<std::vector<double>>& samples, const std::vector<std::int64_t>& stamps_us,
                 double absolute) {
  Measured m;
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const double stamp = absolute > 0.0 ? static_cast<double>(stamps_us[k]) * 1e-6 / absolute : 0.0;
    const Span s =
        absolute > 0.0 ? span_near(samples[k], stamp, kSameClock_s / absolute) : span_of(samples[k]);
    if (!s.finite || !(s.high > s.low)) continue;
    m.spans.push_back(s.high - s.low);
    m.lows.push_back(s.low - stamp);
  }
  return m;
}

}  // namespace

TimeUnit find_time_unit(const std::vector<std::vector<double>>& samples, std::int64_t step_us,
                        double known_unit_s, const std::vector<std::int64_t>& stamps_us) {
  const double absolute = absolute_unit(samples, stamps_us);
  const Measured m = measure(samples, stamps_us, absolute);
  TimeUnit result;
  result.duration_us = step_us;
  if (m.spans.empty()) return result;
  const double span = median(m.spans);  // one damaged scan must not set the measure
  const double step_s = static_cast<double>(step_us) * 1e-6;
  const auto fits = [&](double low, double high) {
    for (const double unit : {1.0, 1e-3, 1e-6, 1e-9})
      if (span * unit >= low * step_s && span * unit <= high * step_s) return unit;
    return 0.0;
  };
  if (absolute > 0.0 && span * absolute >= 0.001 * step_s) {
    result.unit_s = absolute;
    result.absolute = true;
  }
  if (result.unit_s == 0.0 && known_unit_s > 0.0 && span * known_unit_s < 10.0) result.unit_s = known_unit_s;
  if (result.unit_s == 0.0) result.unit_s = fits(0.3, 1.3);
  // Sweeps that overlap: several sensors take turns. Below what 0..1 is of a sweep of 5 Hz.
  if (result.unit_s == 0.0) result.unit_s = fits(1.3, 4.0);
  // Sweeps that are counted from -0.5 or 0.5 on.
  const bool shifted = !m.in_unit_interval() && span > 0.9 && span < 1.02 && std::abs(median(m.lows)) < 1.02;
  if (result.unit_s == 0.0 && ((m.in_unit_interval() && span > 0.5) || shifted)) {
    result.normalised = true;
    if (shifted) {
      result.offset = median(m.lows);
      result.start_us = std::llround(std::min(result.offset, 0.0) * static_cast<double>(step_us));
    }
    return result;
  }
  // A sweep much shorter than the step between scans: scans were left out, or the sensor looks ahead only.
  if (result.unit_s == 0.0) result.unit_s = fits(0.0013, 0.3);
  if (result.unit_s > 0.0) {
    result.duration_us = std::max<std::int64_t>(std::llround(span * result.unit_s * 1e6), 1);
    const double low = median(m.lows) * result.unit_s * 1e6;
    if (result.absolute || (low < 0.0 && low > -2.0 * static_cast<double>(result.duration_us)))
      result.start_us = std::llround(low);
  }
  return result;
}

std::string describe(const TimeUnit& unit) {
  if (unit.normalised && unit.offset != 0.0)
    return fmt::format("{:.2f}..{:.2f} of the sweep", unit.offset, unit.offset + 1.0);
  if (unit.normalised) return "0..1 of the sweep";
  if (unit.unit_s == 0.0) return "an unknown unit, stretched over the sweep";
  return std::string(name_of_unit(unit.unit_s)) + (unit.absolute ? ", absolute" : "");
}

void apply_times(const std::vector<double>& raw, const TimeUnit& unit, Scan& scan) {
  scan.time.clear();
  if (raw.size() != scan.size()) return;
  Span span = span_of(raw);
  if (unit.absolute) {
    const Span near =
        span_near(raw, static_cast<double>(scan.utime) * 1e-6 / unit.unit_s, kSameClock_s / unit.unit_s);
    if (near.finite && near.high > near.low && near.share > 0.5) {
      span.low = near.low;
      span.high = near.high;
      scan.utime = std::llround(span.low * unit.unit_s * 1e6);
    }
  }
  if (!span.finite || !(span.high > span.low)) return;
  double offset = unit.offset;
  double scale = 1.0;
  if (!unit.normalised) {
    const double duration =
        unit.unit_s > 0.0 ? static_cast<double>(unit.duration_us) * 1e-6 / unit.unit_s : span.high - span.low;
    // Times within a sweep begin near the drive's usual start; anything else counts from another zero.
    offset = unit.unit_s > 0.0 && !unit.absolute ? static_cast<double>(unit.start_us) * 1e-6 / unit.unit_s
                                                 : span.low;
    if (span.low < offset - 0.5 * duration || span.high > offset + 1.5 * duration) offset = span.low;
    scale = 1.0 / duration;
  }
  scan.time.resize(raw.size());
  for (std::size_t i = 0; i < raw.size(); ++i)
    scan.time[i] = static_cast<float>(std::clamp((raw[i] - offset) * scale, 0.0, 1.0));
}

TimeSamples sample_times(const std::vector<std::int64_t>& stamps_us,
                         const std::function<void(std::size_t, PointFile&)>& read) {
  TimeSamples samples;
  for (std::size_t i = 0; i < std::min<std::size_t>(stamps_us.size(), 5); ++i) {
    try {
      PointFile file;
      read(i, file);
      if (file.raw_time.empty()) continue;
      samples.raw.push_back(std::move(file.raw_time));
      samples.stamps_us.push_back(stamps_us[i]);
    } catch (const Error&) {
      continue;
    }
  }
  return samples;
}

}  // namespace hp2
