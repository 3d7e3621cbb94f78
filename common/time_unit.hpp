// The unit of times from foreign data.
#pragma once
#include <vector>

namespace hp2 {

/// Shortest and longest plausible step between two scans [s].
constexpr double kShortestStep_s = 0.005, kLongestStep_s = 2.0;

/// Unit of scans' times: 1, 1e-3, 1e-6 or 1e-9 [s], the one that makes the median step plausible. Steps
/// between the ranges of two units count to the coarser one. 0: the steps fit no unit, or nothing rises.
double unit_of_stamps(const std::vector<double>& times);

/// Unit of a trajectory's times [s]. Its steps may have any length: what cannot be seconds since 1970
/// decides, then steps of more than an hour.
double unit_of_trajectory(const std::vector<double>& times);

/// "seconds", "milliseconds", "microseconds" or "nanoseconds".
const char* name_of_unit(double unit_s);

}  // namespace hp2
