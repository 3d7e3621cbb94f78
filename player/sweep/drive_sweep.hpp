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
/// @param vertical_correction -1: scans that "auto" finds to be those of KITTI's HDL-64E are corrected by
/// 0.205
///               degrees, which their publishers' calibration lacks; 0 or 1: the reader does what there is to
///               do
/// @throws Error for an unknown choice
void settle_sweep(Drive& drive, const std::string& choice, std::size_t first, int vertical_correction = 0);

/// True for the beams of an HDL-64E: 60,000 points or more from 25 degrees below the horizon to 3 above.
bool looks_like_hdl64(const Scan& scan);

/// A reading by name: "compensated", "reversed", "clockwise" or "counterclockwise", the latter two from
/// behind or from the azimuth that follows, as in "clockwise:90" [degrees].
/// @throws Error for anything else
SweepReading parse_sweep(const std::string& name);

/// Stamps of a sensor that turns evenly, without the jitter and rounding of the recorded ones. Gaps stay.
/// Unchanged where the stamps are not those of an even turn.
std::vector<std::int64_t> even_stamps(const std::vector<std::int64_t>& stamps);

}  // namespace hp2
