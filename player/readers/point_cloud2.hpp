// sensor_msgs/PointCloud2 as ROS 1 serialises it, decoded from its bytes.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "player/readers/point_file.hpp"

namespace hp2 {

/// Stamp of the message's header [us]; -1 if there is none.
std::int64_t point_cloud2_stamp(std::string_view message);

/// Points of a message; fields x y z and maybe intensity and a time.
/// @param where for the error message
/// @throws Error if the message is not understood or promises more than it has
void parse_point_cloud2(std::string_view message, const std::string& where, PointFile& out);

}  // namespace hp2
