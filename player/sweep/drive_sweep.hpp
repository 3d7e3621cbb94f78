// Gives the scans of a drive the times in the sweep that they lack, if the scans themselves tell which.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "player/readers/drive.hpp"
#include "player/sweep/sweep_reading.hpp"

namespace hp2 {

/// Settles how the points of `drive` lie in the sweep, and changes its stamps, ground truth and decoding
/// accordingly. What was found is a remark in drive.warnings.
/// @param choice "auto": the scans are compared under each reading, and one that is clearly best is taken;
///               "given": nothing is done; else a reading as parse_sweep() knows it
/// @param first  scan from which on the drive is looked at
/// @throws Error for an unknown choice
void settle_sweep(Drive& drive, const std::string& choice, std::size_t first);

/// A reading by name: "compensated", "reversed", "clockwise" or "counterclockwise", the latter two from
/// behind or from the azimuth that follows, as in "clockwise:90" [degrees].
/// @throws Error for anything else
SweepReading parse_sweep(const std::string& name);

/// The name by which parse_sweep() knows a reading; "given" for times as they are.
std::string name_of_sweep(const SweepReading& reading);

/// Stamps of a sensor that turns evenly, without the jitter and rounding of the recorded ones. Gaps stay.
/// Unchanged where the stamps are not those of an even turn.
std::vector<std::int64_t> even_stamps(const std::vector<std::int64_t>& stamps);

}  // namespace hp2
