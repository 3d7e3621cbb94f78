// From the times that a data set has to the times that scans need: strictly rising starts of sweeps, and
// their length.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "player/readers/point_file.hpp"

namespace hp2 {

/// Length of a sweep that is assumed when nothing says otherwise [us].
constexpr std::int64_t kAssumedSweep_us = 100'000;

/// Reads a file of one time [s] a line. What is no number becomes NaN. @throws Error if it cannot be read
std::vector<double> read_times(const std::string& path);

/// Makes n strictly rising stamps [us] out of times [s] as a file has them. Missing ones at the end are
/// continued with the median step. Not finite, equal or falling ones: a warning, and 10 Hz for all of them.
std::vector<std::int64_t> make_stamps(const std::vector<double>& times_s, std::size_t n,
                                      const std::string& what, std::vector<std::string>& warnings);

/// Length of a sweep [us] from the stamps of sweeps that follow one another, with some missing perhaps: the
/// typical one of the short steps. Stamps further apart than 0.21 s are those of a thinned drive:
/// kAssumedSweep_us then.
std::int64_t estimate_sweep(const std::vector<std::int64_t>& stamps);

/// The unit of per-point times, found once a drive.
struct TimeUnit {
  double unit_s = 0.0;           ///< Seconds; 0: no unit that makes sense, each scan is stretched to 0..1.
  bool normalised = false;       ///< They are 0..1 already.
  std::int64_t duration_us = 0;  ///< Length of a sweep.
  std::int64_t start_us = 0;  ///< Start of the sweep after the scan's own stamp: not 0 if times are negative.
};

/// Finds the unit from a few scans' raw times and the typical step between stamps [us].
/// @param known_unit_s seconds, where the format says it; 0: find it
TimeUnit find_time_unit(const std::vector<std::vector<double>>& samples, std::int64_t step_us,
                        double known_unit_s = 0.0);

/// Sets scan.time in [0, 1] from raw times. Absolute times (epoch and the like) count from the scan's first
/// point. Times that are not finite, or all equal: scan.time is left empty.
void apply_times(const std::vector<double>& raw, const TimeUnit& unit, Scan& scan);

}  // namespace hp2
