#include "common/time_unit.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace hp2 {
namespace {

/// Median of the steps that rise; several scans without a time between two share their step. 0: none rises.
double rising_step(const std::vector<double>& times) {
  std::vector<double> steps;
  std::size_t before = times.size();
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (!std::isfinite(times[i])) continue;
    if (before < times.size() && times[i] > times[before])
      steps.push_back((times[i] - times[before]) / static_cast<double>(i - before));
    before = i;
  }
  if (steps.empty()) return 0.0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

}  // namespace

double unit_of_stamps(const std::vector<double>& times) {
  const double step = rising_step(times);
  if (step < kShortestStep_s) return 0.0;
  for (const double unit : {1.0, 1e-3, 1e-6, 1e-9})
    if (step * unit < 2.5 * kLongestStep_s) return unit;  // below the next unit's shortest step
  return 0.0;
}

double unit_of_trajectory(const std::vector<double>& times) {
  double largest = 0.0;
  for (const double t : times)
    if (std::isfinite(t)) largest = std::max(largest, std::abs(t));
  if (largest > 1e17) return 1e-9;
  if (largest > 1e14) return 1e-6;
  if (largest > 1e11) return 1e-3;
  const double step = rising_step(times);
  return step > 3600.0 ? std::max(unit_of_stamps(times), 1e-9) : 1.0;
}

const char* name_of_unit(double unit_s) {
  return unit_s == 1.0    ? "seconds"
         : unit_s == 1e-3 ? "milliseconds"
         : unit_s == 1e-6 ? "microseconds"
                          : "nanoseconds";
}

}  // namespace hp2
