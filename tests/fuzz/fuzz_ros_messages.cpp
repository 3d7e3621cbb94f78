// A message's bytes through the readers of clouds and packets, as ROS 1 and as CDR: understood, or refused
// with an Error. The first byte chooses type and encoding.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "common/error.hpp"
#include "player/readers/bags/cloud_message.hpp"
#include "player/readers/bags/packet_message.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const std::string types[] = {"sensor_msgs/PointCloud2",    "livox_ros_driver2/CustomMsg",
                                      "velodyne_msgs/VelodyneScan", "pandar_msgs/PandarScan",
                                      "nebula_msgs/NebulaPackets",  "ouster_ros/PacketMsg"};
  const std::string& type = types[data[0] / 2 % 6];
  const hp2::Encoding encoding = data[0] % 2 == 0 ? hp2::Encoding::kRos1 : hp2::Encoding::kCdr;
  const std::string_view message(reinterpret_cast<const char*>(data) + 1, size - 1);
  try {
    if (hp2::is_packet_type(type)) {
      std::size_t bytes = 0;
      hp2::for_each_packet(message, type, encoding, 0, "",
                           [&](std::int64_t, std::string_view payload) { bytes += payload.size(); });
      if (bytes > size) std::abort();
      return 0;
    }
    hp2::CloudMessage cloud;
    hp2::parse_cloud(message, type, encoding, "", cloud);
    hp2::PointFile points;
    hp2::read_points(cloud.columns, cloud.columns.x.first ? cloud.points : 0, points);
    if (points.scan.size() > size) std::abort();
  } catch (const hp2::Error&) {
  }
  return 0;
}
