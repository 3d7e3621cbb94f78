// Point clouds as ROS messages: sensor_msgs/PointCloud2 and Livox's CustomMsg, of ROS 1 and ROS 2.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "player/readers/bags/bag_file.hpp"
#include "player/readers/bags/message_reader.hpp"
#include "player/readers/point_file.hpp"

namespace hp2 {

/// Whether messages of this type (as in BagTopic::type) are clouds that are read here.
bool is_cloud_type(const std::string& type);

/// A cloud message whose points are not copied yet.
struct CloudMessage {
  MessageHeader header;
  std::size_t points = 0;
  /// Fields and their places: clouds of one layout have times of one unit.
  std::string layout;
  PointColumns columns;  ///< In the message, or in `packed`. Empty if only the head was read.
  std::string packed;    ///< Rows without what lies between them.
  /// Instant from which the points' times count, where the message has it [us].
  std::optional<std::int64_t> base_us;
};

/// Bytes of a message that hold everything but the points, for all layouts that drivers have.
constexpr std::size_t kCloudHeadBytes = 4096;

/// Header and layout from a message's first bytes.
/// @throws Error if they are damaged
void parse_cloud_head(std::string_view head, const std::string& type, Encoding encoding,
                      const std::string& where, CloudMessage& out);

/// The whole message. Its columns point into `message` and `out.packed`.
/// @throws Error if it is not understood or promises more than it has
void parse_cloud(std::string_view message, const std::string& type, Encoding encoding,
                 const std::string& where, CloudMessage& out);

}  // namespace hp2
