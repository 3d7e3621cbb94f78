#include "player/readers/bags/packet_message.hpp"

#include <algorithm>

#include "player/readers/bags/message_reader.hpp"

namespace hp2 {
namespace {

enum class Kind { kNone, kVelodyneScan, kPandarScan, kNebula, kSinglePacket };

Kind kind_of(const std::string& type) {
  if (type == "velodyne_msgs/VelodyneScan") return Kind::kVelodyneScan;
  if (type == "pandar_msgs/PandarScan") return Kind::kPandarScan;
  if (type == "nebula_msgs/NebulaPackets") return Kind::kNebula;
  if (type == "ouster_ros/PacketMsg" || type == "ouster_sensor_msgs/PacketMsg" ||
      type == "ouster_msgs/PacketMsg")
    return Kind::kSinglePacket;
  return Kind::kNone;
}

std::int64_t take_stamp(MessageReader& reader) {
  const auto seconds = reader.take<std::uint32_t>();
  return static_cast<std::int64_t>(seconds) * 1'000'000 + reader.take<std::uint32_t>() / 1000;
}

}  // namespace

bool is_packet_type(const std::string& type) { return kind_of(type) != Kind::kNone; }

void for_each_packet(std::string_view message, const std::string& type, Encoding encoding,
                     std::int64_t recorded_us, const std::string& where,
                     const std::function<void(std::int64_t, std::string_view)>& use) {
  constexpr std::size_t kVelodyneBytes = 1206, kPandarBytes = 1500;
  MessageReader reader(message, encoding, where);
  const Kind kind = kind_of(type);
  if (kind == Kind::kNone) return;
  if (kind == Kind::kSinglePacket) {
    std::string_view payload = reader.take_bytes(reader.take_count(1));
    if (payload.size() % 4 == 1) payload.remove_suffix(1);  // ROS 1's driver records a byte too many
    use(recorded_us, payload);
    return;
  }
  reader.take_header();
  const std::uint32_t n = reader.take_count(12);
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::int64_t stamp = take_stamp(reader);
    const std::int64_t received = stamp > 0 ? stamp : recorded_us;
    std::string_view payload;
    if (kind == Kind::kVelodyneScan) {
      payload = reader.take_bytes(kVelodyneBytes);
    } else if (kind == Kind::kPandarScan) {
      payload = reader.take_bytes(kPandarBytes);
      payload = payload.substr(0, reader.take<std::uint32_t>());
    } else {
      payload = reader.take_bytes(reader.take_count(1));
    }
    use(received, payload);
  }
}

}  // namespace hp2
