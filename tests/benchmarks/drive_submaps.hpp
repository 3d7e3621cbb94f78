// A drive's submaps as the front-end cuts them, for the back-end to be judged on.
#pragma once
#include <cstddef>
#include <string>

#include "common/session/session_store.hpp"
#include "player/scan_source.hpp"

namespace hp2 {

/// Scans that are missing from a drive.
struct Gap {
  std::size_t first = 0, count = 0;
};

/// Runs the front-end over the drive, without the scans of the gap, and stores its submaps without closing
/// loops.
void register_drive(const ScanSource& source, double submap_length_m, const std::string& mode, const Gap& gap,
                    SessionStore& store);

/// The same submap as an odometry with a systematic error would have made it: its length is off by a share,
/// its heading turns. Points go with the scan that saw them.
Submap with_drift(Submap m, double scale, double yaw_per_m, const Pose& odom_from_submap);

}  // namespace hp2
