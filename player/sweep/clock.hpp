// From the times that a data set has to the times that scans need: strictly rising starts of sweeps, and
// their length.
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "player/readers/point_file.hpp"
#include "player/sweep/stamp_mender.hpp"

namespace hp2 {

/// Makes n strictly rising stamps [us] out of times [s], where no scan may change its place: see
/// mend_stamps(). Missing ones at the end are continued with the usual step.
std::vector<std::int64_t> make_stamps(const std::vector<double>& times_s, std::size_t n,
                                      const std::string& what, std::vector<std::string>& warnings);

/// Length of a sweep [us] from the stamps of sweeps that follow one another, with some missing perhaps: the
/// typical one of the short steps. Stamps further apart than 0.21 s are those of a thinned drive:
/// kAssumedSweep_us then.
std::int64_t estimate_sweep(const std::vector<std::int64_t>& stamps);

/// The unit of per-point times, found once a drive.
struct TimeUnit {
  double unit_s = 0.0;           ///< Seconds; 0: no plausible unit, each scan is stretched to 0..1.
  bool normalised = false;       ///< They count in sweeps: 0..1, or from `offset` on.
  double offset = 0.0;           ///< normalised: the time at which a sweep begins.
  bool absolute = false;         ///< They are on the same clock as the stamps: they give the sweep's start.
  std::int64_t duration_us = 0;  ///< Length of a sweep.
  /// Start of the sweep after the scan's own stamp: not 0 if times are negative, or absolute and of another
  /// instant than the stamp.
  std::int64_t start_us = 0;
};

/// Finds the unit from a few scans' raw times and the typical step between stamps [us].
/// @param known_unit_s seconds, where the format defines it; 0: find it
/// @param stamps_us    the samples' stamps, to recognise absolute times; may be empty
TimeUnit find_time_unit(const std::vector<std::vector<double>>& samples, std::int64_t step_us,
                        double known_unit_s = 0.0, const std::vector<std::int64_t>& stamps_us = {});

/// "nanoseconds", "0..1 of the sweep", ...; for people.
std::string describe(const TimeUnit& unit);

/// Sets scan.time in [0, 1] from raw times. Times of another clock count from the scan's first point;
/// absolute ones set scan.utime as well, which must be the stamp plus `start_us`. Times that are not finite,
/// or all equal: scan.time is left empty.
void apply_times(const std::vector<double>& raw, const TimeUnit& unit, Scan& scan);

/// A few scans' raw times and what goes with them.
struct TimeSamples {
  std::vector<std::vector<double>> raw;  ///< Of scans that have any.
  std::vector<std::int64_t> stamps_us;   ///< Of the same scans.
};

/// Reads up to five scans from the first on, for find_time_unit(). Scans that cannot be read are passed over:
/// their damage is reported when it is their turn.
/// @param read reads scan i
TimeSamples sample_times(const std::vector<std::int64_t>& stamps_us,
                         const std::function<void(std::size_t, PointFile&)>& read);

}  // namespace hp2
