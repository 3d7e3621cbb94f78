// What tells one data set's folder from another's.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// Camera-from-LiDAR transform of a KITTI calib.txt (line `Tr:`); nothing if there is no such file or line.
std::optional<Pose> kitti_camera_from_lidar(const std::string& path);

/// Time [us] that a file is named by (19 digits: nanoseconds, 16: microseconds); -1 if its name is no time.
std::int64_t stamp_of_name(const std::string& name);

/// Format of the drive at `path`, see SourceInfo::format; "" if it is none that is known.
std::string recognise_format(const std::string& path);

}  // namespace hp2
