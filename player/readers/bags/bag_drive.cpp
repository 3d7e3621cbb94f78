// A recording of ROS messages as a drive: which topic, and when its scans began.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>

#include "common/error.hpp"
#include "player/readers/bags/cloud_message.hpp"
#include "player/readers/bags/cloud_times.hpp"
#include "player/readers/bags/packet_message.hpp"
#include "player/readers/bags/packet_topic.hpp"
#include "player/readers/bags/pose_topic.hpp"
#include "player/readers/bags/recording.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kLongestPoseGap_us = 1'000'000;

bool is_readable(const BagTopic& topic) {
  return topic.count > 0 && topic.encoding != Encoding::kOther &&
         (is_cloud_type(topic.type) || is_packet_type(topic.type));
}

std::string list_topics(const Recording& recording, bool readable_only) {
  constexpr std::size_t kMost = 20;
  std::string list;
  std::size_t listed = 0;
  for (const BagTopic& topic : recording.topics()) {
    if (topic.count == 0 || (readable_only && !is_readable(topic))) continue;
    if (++listed <= kMost) list += (list.empty() ? "" : "; ") + recording.describe(topic);
  }
  if (listed > kMost) list += "; and " + std::to_string(listed - kMost) + " more";
  return list;
}

/// The topic to play: the one that is asked for, or the only one with clouds, or else with packets.
const BagTopic& choose_topic(const Recording& recording, const std::string& wanted) {
  constexpr std::uint64_t kLeastLidarBytes = 500;  // what is smaller is an IMU's packet
  std::vector<const BagTopic*> clouds, packets;
  bool is_there = false;
  for (const BagTopic& topic : recording.topics()) {
    const bool asked = wanted.empty() || topic.name == wanted || topic.name == "/" + wanted;
    is_there = is_there || (asked && topic.count > 0);
    if (!asked || !is_readable(topic)) continue;
    if (is_cloud_type(topic.type))
      clouds.push_back(&topic);
    else if (!wanted.empty() || recording.message_size(topic) >= kLeastLidarBytes)
      packets.push_back(&topic);
  }
  const auto& found = clouds.empty() ? packets : clouds;
  if (found.size() == 1) return *found.front();
  const std::string readable = list_topics(recording, true);
  if (found.size() > 1)
    throw Error("the recording has several topics with LiDAR scans", recording.path(),
                "Name one with --topic: " + readable + ".");
  if (readable.empty()) {
    const std::string all = list_topics(recording, false);
    throw Error(
        "the recording has no topic with LiDAR scans that are known (sensor_msgs/PointCloud2, Livox "
        "CustomMsg, VelodyneScan, PandarScan, Ouster PacketMsg)",
        recording.path(), all.empty() ? "It has no message at all." : "It has: " + all + ".");
  }
  throw Error(is_there ? "the topic " + wanted + " holds no LiDAR scans that are known"
                       : "the recording has no topic " + wanted,
              recording.path(), "Topics with scans are: " + readable + ".");
}

void set_ground_truth(const Recording& recording, const std::string& topic, const std::string& lidar_frame,
                      Drive& drive) {
  PoseTopic truth = read_pose_topic(recording, topic, lidar_frame);
  drive.warnings.insert(drive.warnings.end(), truth.warnings.begin(), truth.warnings.end());
  std::size_t without = 0;
  for (const DriveScan& scan : drive.scans) {
    drive.ground_truth.push_back(pose_at(truth.poses, scan.utime_end(), kLongestPoseGap_us));
    without += !drive.ground_truth.back();
  }
  if (without == drive.scans.size())
    throw Error("no pose on the topic " + topic + " is near a scan in time", recording.path(),
                "Its clock is another one, or it was recorded at another time: choose another topic.");
  if (without > 0)
    drive.warnings.push_back(std::to_string(without) + " of " + std::to_string(drive.scans.size()) +
                             " scans have no pose on " + topic + " within 1 s");
}

/// Scans, stamps and decoder of a topic with clouds.
void set_cloud_scans(std::shared_ptr<const Recording> recording, const BagTopic& topic, Drive& drive,
                     std::string& frame) {
  auto clouds = std::make_shared<const TimedClouds>(time_clouds(*recording, topic, drive.warnings));
  frame = clouds->frame;
  drive.time_in_sweep = clouds->time_in_sweep;
  for (std::size_t i = 0; i < clouds->scans.size(); ++i) {
    const TimedCloud& scan = clouds->scans[i];
    drive.scans.push_back(
        {drive.info.path, scan.utime, clouds->units[scan.layout].duration_us, static_cast<std::int64_t>(i)});
  }
  drive.decode = [recording = std::move(recording), clouds, type = topic.type, encoding = topic.encoding,
                  name = topic.name](const DriveScan& entry, Scan& scan) {
    thread_local MessageBytes memory;  // these keep their memory from scan to scan
    thread_local CloudMessage message;
    thread_local PointFile points;
    const TimedCloud& cloud = clouds->scans[static_cast<std::size_t>(entry.key)];
    const std::string where = entry.path + ", " + name + ", message " + std::to_string(entry.key);
    parse_cloud(recording->read(cloud.ref, kMaxFileBytes, memory), type, encoding, where, message);
    read_points(message.columns, message.columns.x.first ? message.points : 0, points);
    move_points(points, scan);
    apply_cloud_times(*clouds, cloud, points.raw_time, scan);
    memory.chunk.reset();
  };
}

}  // namespace

Drive open_bag(const std::string& path, const std::string& format, const SourceOptions& options) {
  const auto wanted = [&](const std::string& type) {
    return is_cloud_type(type) || is_packet_type(type) || type == "std_msgs/String" ||
           (!options.ground_truth_topic.empty() && (is_pose_type(type) || is_transform_type(type)));
  };
  const auto recording = std::make_shared<const Recording>(path, wanted);
  const BagTopic& topic = choose_topic(*recording, options.topic);
  Drive drive;
  drive.info = {stem(base_name(path)), format, "", path};
  drive.warnings = recording->warnings();
  std::string frame;
  if (is_cloud_type(topic.type))
    set_cloud_scans(recording, topic, drive, frame);
  else
    set_packet_topic_scans(recording, topic, options.metadata, drive, frame);
  if (!options.ground_truth_topic.empty())
    set_ground_truth(*recording, options.ground_truth_topic, frame, drive);
  return drive;
}

}  // namespace hp2
