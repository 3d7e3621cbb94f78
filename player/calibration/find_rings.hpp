// Which vertical angles a sensor's points have: its rings, where each has an angle of its own.
#pragma once
#include <vector>

#include "common/scan.hpp"

namespace hp2 {

/// Vertical angle of each ring [deg], rising. A ring is a peak of the angles' histogram that is narrow
/// against the gaps beside it.
/// @param scans some of the drive's, not motion-compensated
/// @return empty where nearly all points do not lie in such peaks: rings cannot be told
std::vector<double> find_rings(const std::vector<Scan>& scans);

}  // namespace hp2
