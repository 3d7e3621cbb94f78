// Stamps of a drive's scans, mended one at a time: a wrong stamp costs its scan nothing, and no other scan
// anything.
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace hp2 {

/// Length of a sweep that is assumed when nothing else is known [us].
constexpr std::int64_t kAssumedSweep_us = 100'000;

/// What is known of the scans besides their stamps.
struct MendOptions {
  /// Whether a scan may change its place: false where the order is certain, as with numbered frames.
  bool may_reorder = true;
  /// Whether two scans have the same points. Asked only where stamps are equal or very near. Empty: never.
  std::function<bool(std::size_t, std::size_t)> same_points;
};

/// Stamps that can be used, and what was done to get them.
struct MendedStamps {
  std::vector<std::size_t> order;       ///< The scans that are kept, in order of time: places in the input.
  std::vector<std::int64_t> stamps_us;  ///< One per kept scan, strictly rising.
  std::vector<std::string> warnings;    ///< One sentence per kind of damage, with the number of scans.
};

/// Mends the stamps of scans in the order in which the data set has them.
///
/// - Copies (equal or near stamps, same points) are left out.
/// - A scan whose stamp fits a gap before it came late: it is moved there.
/// - A single stamp that contradicts its neighbours, or is missing, is replaced by one between theirs.
/// - Where the clock steps back for good, the stamps after it are shifted so that time continues.
/// - Where it jumps ahead for good, the stamps stay as they are, and the jump is reported.
/// - Stamps that rarely rise are not used: 10 Hz is assumed.
///
/// @param times_s one per scan [s]; not finite: missing
/// @param what    where they were found, for the warnings
MendedStamps mend_stamps(const std::vector<double>& times_s, const std::string& what,
                         const MendOptions& options = {});

}  // namespace hp2
