// LiDAR packets inside ROS messages, as drivers record them.
#pragma once
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "player/readers/bags/bag_file.hpp"

namespace hp2 {

/// Whether messages of this type hold a LiDAR's packets that are taken out here.
bool is_packet_type(const std::string& type);

/// Calls `use(received_us, payload)` for each packet of a message, in its order.
/// @param recorded_us when the message was recorded: for packets that carry no time of their own
/// @throws Error if the message is damaged
void for_each_packet(std::string_view message, const std::string& type, Encoding encoding,
                     std::int64_t recorded_us, const std::string& where,
                     const std::function<void(std::int64_t, std::string_view)>& use);

}  // namespace hp2
