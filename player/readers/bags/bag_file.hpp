// What every kind of bag is to its user: topics, and the messages on them.
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "player/readers/bags/compression.hpp"

namespace hp2 {

/// How the messages of a topic are written.
enum class Encoding {
  kRos1,  ///< ROS 1: little-endian, without gaps.
  kCdr,   ///< CDR with its encapsulation header, either byte order.
  kOther  ///< Not understood here (protobuf, JSON, ...).
};

/// Where a message lies; the meaning of the numbers is the bag's own.
struct MessageRef {
  std::int64_t utime = 0;   ///< When it was recorded [us].
  std::uint64_t at = 0;     ///< Offset, or the number of a row.
  std::uint32_t chunk = 0;  ///< Chunk of the file.
  std::uint32_t file = 0;   ///< Part of the recording; set by the caller that opens several.
};

/// A topic of a bag.
struct BagTopic {
  std::string name;
  std::string type;  ///< As ROS 1 writes it: "sensor_msgs/PointCloud2".
  Encoding encoding = Encoding::kOther;
  std::uint64_t count = 0;                 ///< Messages.
  std::int64_t first_us = 0, last_us = 0;  ///< When the first and the last of them were recorded.
  bool wanted = false;                     ///< Its messages are in `refs`; else they are counted only.
  std::vector<MessageRef> refs;
};

/// Memory of a message that was read; used again from message to message.
struct MessageBytes {
  std::string own;
  std::string expanded;
  std::shared_ptr<const Expanded> chunk;
};

/// Which types' messages are to be found; the messages of others are counted only.
using WantedTypes = std::function<bool(const std::string& type)>;

/// One file of a recording. Reading is thread-safe.
class BagFile {
 public:
  virtual ~BagFile() = default;
  /// The message's bytes, at most `most` of them; they live as long as `memory` is left alone.
  /// @throws Error if the file is damaged there
  virtual std::string_view read(const MessageRef& ref, std::size_t most, MessageBytes& memory) const = 0;

  const std::vector<BagTopic>& topics() const { return topics_; }
  /// What is damaged or missing, as text.
  const std::vector<std::string>& warnings() const { return warnings_; }

 protected:
  std::vector<BagTopic> topics_;
  std::vector<std::string> warnings_;
};

/// "sensor_msgs/msg/PointCloud2" (ROS 2) as "sensor_msgs/PointCloud2".
std::string common_type_name(const std::string& type);

/// Index of the topic of this name, type and encoding in `topics`; added if it is not there yet.
std::size_t topic_index(std::vector<BagTopic>& topics, const std::string& name, const std::string& type,
                        Encoding encoding, const WantedTypes& wanted);

/// Counts a message, and keeps it if the topic is wanted.
void add_message(BagTopic& topic, const MessageRef& ref);

/// Sorts the messages by place. A damaged index may list one more than once: it counts once.
void drop_repeated(BagTopic& topic);

/// Opens a ROS 1 bag (format 2.0), with index or without. @throws Error if it is none
std::unique_ptr<BagFile> open_ros1_bag(const PlainFile& file, const WantedTypes& wanted);
/// Opens an MCAP file, with index or without. @throws Error if it is none
std::unique_ptr<BagFile> open_mcap(const PlainFile& file, const WantedTypes& wanted);
/// Opens a ROS 2 bag in SQLite (.db3). @throws Error if it is none
std::unique_ptr<BagFile> open_db3(const PlainFile& file, const WantedTypes& wanted);

}  // namespace hp2
