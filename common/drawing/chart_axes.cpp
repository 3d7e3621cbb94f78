#include <algorithm>
#include <cmath>
#include <cstdio>

#include "common/drawing/chart.hpp"

namespace hp2 {

Axis make_axis(double low, double high, int wanted) {
  Axis axis;
  if (!(std::isfinite(low) && std::isfinite(high))) low = 0, high = 1;
  if (high - low < 1e-12 * std::max(1.0, std::abs(low))) low -= 0.5, high += 0.5;
  axis.low = low;
  axis.high = high;
  const double raw = (high - low) / std::max(wanted, 1);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = power;
  for (const double factor : {1.0, 2.0, 5.0, 10.0}) {
    step = factor * power;
    if (step >= raw * 0.999) break;
  }
  const int decimals = std::max(0, -static_cast<int>(std::floor(std::log10(step) + 1e-9)));
  for (double k = std::ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; ++k) {
    axis.ticks.push_back(k * step);
    char text[40];
    std::snprintf(text, sizeof text, "%.*f", std::min(decimals, 9), k == 0 ? 0.0 : k * step);
    axis.labels.emplace_back(text);
  }
  return axis;
}

Axis make_log_axis(double low, double high) {
  Axis axis;
  if (!(low > 0 && std::isfinite(high) && high >= low)) low = 0.1, high = 10;
  axis.low = std::log10(low);
  axis.high = std::log10(high);
  if (axis.high - axis.low < 0.1) axis.low -= 0.5, axis.high += 0.5;
  const bool only_decades = axis.high - axis.low > 4;
  for (int e = static_cast<int>(std::floor(axis.low)); e <= static_cast<int>(std::ceil(axis.high)); ++e) {
    for (const int m : {1, 2, 5}) {
      if (only_decades && m != 1) continue;
      const double value = m * std::pow(10.0, e), at = std::log10(value);
      if (at < axis.low - 1e-9 || at > axis.high + 1e-9) continue;
      axis.ticks.push_back(at);
      char text[40];
      std::snprintf(text, sizeof text, "%g", value);
      axis.labels.emplace_back(text);
    }
  }
  return axis;
}

}  // namespace hp2
