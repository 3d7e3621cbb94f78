// What the first scans of a drive show about all of them: the unit of lengths, and whether a sweep comes in
// parts.
#pragma once
#include <string>

#include "player/readers/drive.hpp"

namespace hp2 {

/// Scales the points to metres where they are millimetres, with a remark in the drive's warnings.
/// @param unit "m", "mm", "cm"; "": find it
/// @throws Error if the points are no LiDAR's in any unit, or the unit is not known
void settle_length_unit(Drive& drive, const std::string& unit = "");

/// Puts sweeps together whose driver sends each in several parts, such as 30 degrees per message. Parts are
/// recognised by their azimuths, which go round one after the other. Does nothing where scans are whole.
void join_parts(Drive& drive);

}  // namespace hp2
