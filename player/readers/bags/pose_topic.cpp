#include "player/readers/bags/pose_topic.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "common/error.hpp"
#include "player/readers/bags/message_reader.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMaxTransforms = 10'000;

/// A pose message, before frames are considered.
struct PoseMessage {
  std::int64_t utime = 0;
  std::string child;  ///< The frame that the pose is of; "" if the message does not name it.
  Pose pose;
};

Eigen::Vector3d take_vector(MessageReader& reader) {
  const double x = reader.take<double>();
  const double y = reader.take<double>();
  return {x, y, reader.take<double>()};
}

/// Translation, then x y z w; nothing if it is no pose.
std::optional<Pose> take_pose(MessageReader& reader) {
  const Eigen::Vector3d t = take_vector(reader);
  const Eigen::Vector3d v = take_vector(reader);
  const Eigen::Quaterniond q(reader.take<double>(), v.x(), v.y(), v.z());
  if (!t.allFinite() || !(std::abs(q.norm() - 1.0) < 0.01)) return std::nullopt;
  return Pose(q.normalized(), t);
}

/// East, north, up [m] of a place on the earth (WGS 84) as seen from the first one.
class LocalPlane {
 public:
  Eigen::Vector3d place(double latitude_deg, double longitude_deg, double altitude_m) {
    const double lat = latitude_deg * M_PI / 180.0;
    const double lon = longitude_deg * M_PI / 180.0;
    constexpr double kRadius = 6378137.0, kEccentricity2 = 6.69437999014e-3;
    const double n = kRadius / std::sqrt(1.0 - kEccentricity2 * std::sin(lat) * std::sin(lat));
    const Eigen::Vector3d p((n + altitude_m) * std::cos(lat) * std::cos(lon),
                            (n + altitude_m) * std::cos(lat) * std::sin(lon),
                            (n * (1.0 - kEccentricity2) + altitude_m) * std::sin(lat));
    if (!has_origin_) {
      has_origin_ = true;
      origin_ = p;
      axes_ << -std::sin(lon), std::cos(lon), 0.0,  //
          -std::sin(lat) * std::cos(lon), -std::sin(lat) * std::sin(lon), std::cos(lat),
          std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat);
    }
    return axes_ * (p - origin_);
  }

 private:
  bool has_origin_ = false;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes_ = Eigen::Matrix3d::Identity();
};

bool is_fix(const std::string& type) { return type == "sensor_msgs/NavSatFix"; }

std::optional<PoseMessage> parse_pose(MessageReader& reader, const std::string& type, LocalPlane& plane) {
  PoseMessage message;
  message.utime = reader.take_header().stamp_us;
  if (is_fix(type)) {
    const auto status = reader.take<std::int8_t>();
    reader.take<std::uint16_t>();  // which satellites
    const Eigen::Vector3d p = take_vector(reader);
    if (status < 0 || !p.allFinite()) return std::nullopt;
    message.pose = Pose(Eigen::Quaterniond::Identity(), plane.place(p.x(), p.y(), p.z()));
    return message;
  }
  if (type == "nav_msgs/Odometry" || type == "geometry_msgs/TransformStamped")
    message.child = std::string(reader.take_string());
  const std::optional<Pose> pose = take_pose(reader);
  if (!pose) return std::nullopt;
  message.pose = *pose;
  return message;
}

/// Fixed transforms: a frame's parent, and the parent-from-frame pose.
using Transforms = std::map<std::string, std::pair<std::string, Pose>>;

std::string without_slash(const std::string& frame) {
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

Transforms read_transforms(const Recording& recording) {
  Transforms transforms;
  MessageBytes memory;
  for (const BagTopic& topic : recording.topics()) {
    if (!is_transform_type(topic.type) || topic.name.find("tf_static") == std::string::npos) continue;
    for (const MessageRef& ref : topic.refs) {
      try {
        MessageReader reader(recording.read(ref, kMaxFileBytes, memory), topic.encoding, topic.name);
        const std::uint32_t n = reader.take_count(68);
        for (std::uint32_t i = 0; i < n && transforms.size() < kMaxTransforms; ++i) {
          const std::string parent = without_slash(reader.take_header().frame);
          const std::string child = without_slash(std::string(reader.take_string()));
          if (const auto pose = take_pose(reader)) transforms[child] = {parent, *pose};
        }
      } catch (const Error&) {
        continue;  // a damaged transform is as one that is missing, which is reported
      }
    }
  }
  return transforms;
}

/// root_from_frame for a frame and all its ancestors; the walk ends where it meets a frame twice.
std::vector<std::pair<std::string, Pose>> ancestors(const Transforms& transforms, std::string frame) {
  std::vector<std::pair<std::string, Pose>> chain = {{frame, Pose()}};
  std::set<std::string> seen = {frame};
  for (auto it = transforms.find(frame); it != transforms.end(); it = transforms.find(frame)) {
    const Pose parent_from_frame = it->second.second * chain.back().second;
    frame = it->second.first;
    if (!seen.insert(frame).second) break;
    chain.emplace_back(frame, parent_from_frame);
  }
  return chain;
}

/// body_from_lidar by the fixed transforms, if they connect the two frames.
std::optional<Pose> find_transform(const Transforms& transforms, const std::string& body,
                                   const std::string& lidar) {
  const auto of_lidar = ancestors(transforms, without_slash(lidar));
  for (const auto& [frame, frame_from_body] : ancestors(transforms, without_slash(body)))
    for (const auto& [other, other_from_lidar] : of_lidar)
      if (frame == other) return frame_from_body.inverse() * other_from_lidar;
  return std::nullopt;
}

const BagTopic& find_topic(const Recording& recording, const std::string& name) {
  std::string list;
  for (const BagTopic& topic : recording.topics()) {
    if (!is_pose_type(topic.type) || topic.count == 0) continue;
    if (topic.name == name || topic.name == "/" + name) return topic;
    list += (list.empty() ? "" : ", ") + topic.name + " (" + topic.type + ")";
  }
  throw Error("the recording has no poses on the topic " + name, recording.path(),
              list.empty() ? "It has no topic with poses." : "Topics with poses are: " + list + ".");
}

}  // namespace

bool is_pose_type(const std::string& type) {
  return type == "nav_msgs/Odometry" || type == "geometry_msgs/PoseStamped" ||
         type == "geometry_msgs/PoseWithCovarianceStamped" || type == "geometry_msgs/TransformStamped" ||
         is_fix(type);
}

bool is_transform_type(const std::string& type) {
  return type == "tf2_msgs/TFMessage" || type == "tf/tfMessage";
}

PoseTopic read_pose_topic(const Recording& recording, const std::string& name,
                          const std::string& lidar_frame) {
  const BagTopic& topic = find_topic(recording, name);
  PoseTopic result;
  LocalPlane plane;
  MessageBytes memory;
  std::size_t bad = 0;
  std::string body;
  for (const MessageRef& ref : topic.refs) {
    try {
      MessageReader reader(recording.read(ref, kMaxFileBytes, memory), topic.encoding,
                           recording.path() + ", topic " + topic.name);
      const auto message = parse_pose(reader, topic.type, plane);
      bad += !message;
      if (!message) continue;
      if (!message->child.empty()) body = message->child;
      result.poses.push_back({message->utime > 0 ? message->utime : ref.utime, message->pose});
    } catch (const Error&) {
      ++bad;
    }
  }
  if (result.poses.empty())
    throw Error(
        "no message on the topic " + topic.name + " holds a pose", recording.path(),
        is_fix(topic.type) ? "The receiver had no fix." : "Choose another topic with --ground-truth-topic.");
  if (bad > 0)
    result.warnings.push_back(std::to_string(bad) + " messages on " + topic.name +
                              " hold no pose: they are left out");
  if (is_fix(topic.type))
    result.warnings.push_back("the ground truth on " + topic.name +
                              " has positions only, of the antenna: compare positions, not orientations");
  const auto body_from_lidar = find_transform(read_transforms(recording), body, lidar_frame);
  if (!body.empty() && body_from_lidar)
    for (StampedPose& p : result.poses) p.pose = p.pose * *body_from_lidar;
  else if (!body.empty() && !is_fix(topic.type))
    result.warnings.push_back("the ground truth on " + topic.name + " is of the frame " + body +
                              ", and /tf_static does not connect it to the LiDAR's frame " + lidar_frame +
                              ": it is taken as the LiDAR's");
  std::stable_sort(result.poses.begin(), result.poses.end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.utime < b.utime; });
  return result;
}

}  // namespace hp2
