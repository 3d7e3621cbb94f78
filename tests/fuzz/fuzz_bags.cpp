// Bytes of a file through the readers of ROS 1 bags, MCAP and SQLite bags: index, times, scans, poses. They
// are read, or refused with an Error; nothing else. The readers take files: the bytes lie in one that exists
// in memory only.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <unistd.h>

#include "common/error.hpp"
#include "player/readers/bags/cloud_message.hpp"
#include "player/readers/bags/cloud_times.hpp"
#include "player/readers/bags/packet_message.hpp"
#include "player/readers/bags/pose_topic.hpp"

namespace {

constexpr std::size_t kMostScans = 8;

void read_clouds(const hp2::Recording& recording, const hp2::BagTopic& topic) {
  std::vector<std::string> warnings;
  const hp2::TimedClouds clouds = hp2::time_clouds(recording, topic, warnings);
  for (std::size_t i = 0; i < clouds.scans.size() && i < kMostScans; ++i) {
    try {
      hp2::MessageBytes memory;
      hp2::CloudMessage message;
      hp2::PointFile points;
      hp2::parse_cloud(recording.read(clouds.scans[i].ref, hp2::kMaxFileBytes, memory), topic.type,
                       topic.encoding, "", message);
      hp2::read_points(message.columns, message.columns.x.first ? message.points : 0, points);
      hp2::Scan scan;
      hp2::move_points(points, scan);
      hp2::apply_cloud_times(clouds, clouds.scans[i], points.raw_time, scan);
      if (scan.y.size() != scan.size() || scan.z.size() != scan.size()) std::abort();
      if (!scan.time.empty() && scan.time.size() != scan.size()) std::abort();
    } catch (const hp2::Error&) {
    }
  }
}

void read_topic(const hp2::Recording& recording, const hp2::BagTopic& topic) {
  try {
    if (hp2::is_cloud_type(topic.type) && topic.count > 0) read_clouds(recording, topic);
    if (hp2::is_pose_type(topic.type)) hp2::read_pose_topic(recording, topic.name, "lidar");
    if (!hp2::is_packet_type(topic.type) || topic.refs.empty()) return;
    hp2::MessageBytes memory;
    std::size_t bytes = 0;
    hp2::for_each_packet(recording.read(topic.refs.front(), hp2::kMaxFileBytes, memory), topic.type,
                         topic.encoding, 0, "",
                         [&](std::int64_t, std::string_view payload) { bytes += payload.size(); });
  } catch (const hp2::Error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static std::string path = "/dev/shm/hp2_fuzz_XXXXXX";  // SQLite opens names only
  static const int file = ::mkstemp(path.data());
  static const bool registered = std::atexit([] { ::unlink(path.c_str()); }) == 0;
  if (!registered) std::abort();
  if (::ftruncate(file, 0) != 0 || ::pwrite(file, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  try {
    const hp2::Recording recording(path, [](const std::string&) { return true; });
    for (const hp2::BagTopic& topic : recording.topics()) read_topic(recording, topic);
  } catch (const hp2::Error&) {
  }
  return 0;
}
