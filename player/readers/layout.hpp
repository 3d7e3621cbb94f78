// Recognises the data set of a folder.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// Camera-from-LiDAR transform of a KITTI calib.txt (line `Tr:`); nothing if there is no such file or line.
std::optional<Pose> kitti_camera_from_lidar(const std::string& path);

/// Time [us] that a file is named by, alone or after an underscore: 19 digits (nanoseconds), 16
/// (microseconds), SECONDS.FRACTION, SECONDS_NANOSECONDS; -1 if its name is not a time.
std::int64_t stamp_of_name(const std::string& name);

/// Stamps [us] of files that are named by their times. Names that are none, or do not rise: 10 Hz, and a
/// warning.
std::vector<std::int64_t> stamps_of_names(const std::string& folder, const std::vector<std::string>& names,
                                          std::vector<std::string>& warnings);

/// Names of the .bin files in `folder`. @throws Error if there is none
std::vector<std::string> list_bin_scans(const std::string& folder);

/// The sensor's folder of a HeLiPR drive (`DRIVE`, `DRIVE/LiDAR` or `DRIVE/LiDAR/SENSOR`): all that are
/// there.
std::vector<std::string> helipr_sensor_folders(const std::string& folder);

/// Format of the drive at `path`, see SourceInfo::format; "" if it is none that is known.
std::string recognise_format(const std::string& path);

}  // namespace hp2
