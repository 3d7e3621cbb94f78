// A recording of ROS messages: one bag, or a folder of the parts of one.
#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "player/readers/bags/bag_file.hpp"

namespace hp2 {

/// Whether `path` is a bag by its first bytes (or, compressed as a whole, by its name), or a folder with bags
/// in it. "rosbag" (ROS 1), "rosbag2" (.db3, .mcap) or "".
std::string recognise_bag(const std::string& path);

/// All files of a recording, opened. Reading is thread-safe.
class Recording {
 public:
  /// @throws Error if no part of it can be opened
  Recording(const std::string& path, const WantedTypes& wanted);

  const std::string& path() const { return path_; }
  /// Topics of all parts; their messages in the order in which they are stored.
  const std::vector<BagTopic>& topics() const { return topics_; }
  const std::vector<std::string>& warnings() const { return warnings_; }

  /// See BagFile::read.
  std::string_view read(const MessageRef& ref, std::size_t most, MessageBytes& memory) const;

  /// Bytes of the topic's first message; 0 if it cannot be read.
  std::uint64_t message_size(const BagTopic& topic) const;
  /// "/points (sensor_msgs/PointCloud2, 200 messages, 10.0 Hz, 1.3 MB each)"
  std::string describe(const BagTopic& topic) const;

 private:
  std::string path_;
  std::vector<std::unique_ptr<BagFile>> files_;
  std::vector<BagTopic> topics_;
  std::vector<std::string> warnings_;
};

}  // namespace hp2
