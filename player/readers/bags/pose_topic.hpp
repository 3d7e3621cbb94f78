// Ground truth from a recording's own topics.
#pragma once
#include <string>
#include <vector>

#include "player/readers/bags/recording.hpp"
#include "player/scan_source.hpp"

namespace hp2 {

/// Whether messages of this type hold poses that are read here: Odometry, PoseStamped,
/// PoseWithCovarianceStamped, TransformStamped, NavSatFix.
bool is_pose_type(const std::string& type);
/// Whether messages of this type hold fixed transforms between frames (TFMessage).
bool is_transform_type(const std::string& type);

/// Poses of a topic, sorted by time, in the LiDAR's frame where the recording's fixed transforms (/tf_static)
/// give it.
struct PoseTopic {
  std::vector<StampedPose> poses;
  std::vector<std::string> warnings;
};

/// Reads the poses on `topic`. A NavSatFix is a position (east, north, up from the first one) without
/// orientation.
/// @param lidar_frame frame of the scans
/// @throws Error if there is no such topic or it holds no pose
PoseTopic read_pose_topic(const Recording& recording, const std::string& topic,
                          const std::string& lidar_frame);

}  // namespace hp2
