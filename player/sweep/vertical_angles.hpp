// The vertical angles of KITTI's HDL-64E, which its publishers' calibration has too low.
#pragma once
#include "player/readers/drive.hpp"

namespace hp2 {

/// True for scans as KITTI has published them, in whatever file they are now: the beams of an HDL-64E,
/// lengths in whole millimetres, and intensities, if there are any, in hundredths.
bool looks_like_kitti(const Scan& scan);

/// The 0.205 degrees by which the vertical angles of the KITTI odometry benchmark's scans are off (IMLS-SLAM,
/// KISS-ICP): each point is turned up by it about the horizontal axis through the sensor.
void correct_kitti_vertical_angle(Scan& scan);

/// Has the drive's vertical angles corrected by 0.205 degrees (correct_kitti_vertical_angle()), and adds a
/// remark on it.
/// @param correction 1: yes; 0: no; -1: if the format is one of KITTI's, or the scans look like KITTI's
/// @param first      scan from which on the drive is looked at
void settle_vertical_angles(Drive& drive, int correction, std::size_t first);

}  // namespace hp2
