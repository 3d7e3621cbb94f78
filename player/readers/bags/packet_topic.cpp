#include "player/readers/bags/packet_topic.hpp"

#include <algorithm>
#include <atomic>

#include "common/error.hpp"
#include "player/packets/packet_decoder.hpp"
#include "player/readers/bags/message_reader.hpp"
#include "player/readers/bags/packet_message.hpp"

namespace hp2 {
namespace {

constexpr int kPacketBits =
    20;  // of a packet's key: its place in the message; the rest is the message's number
constexpr std::size_t kTriedMessages = 200;

/// Text of a std_msgs/String topic that looks like an Ouster's metadata, or of a JSON file beside the
/// recording.
PacketSensorOptions find_metadata(const Recording& recording, const std::string& given) {
  PacketSensorOptions options;
  options.where = recording.path();
  if (!given.empty()) {
    options.metadata_name = given;
    options.metadata = read_text(given);
    return options;
  }
  MessageBytes memory;
  for (const BagTopic& topic : recording.topics()) {
    if (topic.type != "std_msgs/String" || topic.refs.empty() ||
        topic.name.find("metadata") == std::string::npos)
      continue;
    MessageReader reader(recording.read(topic.refs.front(), kMaxFileBytes, memory), topic.encoding,
                         topic.name);
    options.metadata = std::string(reader.take_string());
    options.metadata_name = recording.path() + ", topic " + topic.name;
    return options;
  }
  const std::string folder = is_folder(recording.path()) ? recording.path() : parent_folder(recording.path());
  const std::string own = folder + "/" + stem(base_name(recording.path())) + ".json";
  const std::vector<std::string> there = list_files(folder, ".json");
  if (is_file(own))
    options.metadata_name = own;
  else if (there.size() == 1)
    options.metadata_name = folder + "/" + there.front();
  if (!options.metadata_name.empty()) options.metadata = read_text(options.metadata_name);
  return options;
}

/// The topic's messages in the order of recording.
std::vector<MessageRef> in_order(const BagTopic& topic) {
  std::vector<MessageRef> refs = topic.refs;
  std::stable_sort(refs.begin(), refs.end(),
                   [](const MessageRef& a, const MessageRef& b) { return a.utime < b.utime; });
  return refs;
}

}  // namespace

void set_packet_topic_scans(std::shared_ptr<const Recording> recording, const BagTopic& topic,
                            const std::string& metadata, Drive& drive, std::string& frame) {
  const auto refs = std::make_shared<const std::vector<MessageRef>>(in_order(topic));
  const PacketSensorOptions options = find_metadata(*recording, metadata);
  const std::string where = recording->path() + ", " + topic.name;
  std::shared_ptr<const PacketSensor> sensor;
  MessageBytes memory;
  for (std::size_t i = 0; i < std::min(refs->size(), kTriedMessages) && !sensor; ++i) {
    const MessageRef& ref = (*refs)[i];
    const std::string_view bytes = recording->read(ref, kMaxFileBytes, memory);
    if (frame.empty() && topic.type.find("PacketMsg") == std::string::npos)
      frame = MessageReader(bytes, topic.encoding, where).take_header().frame;
    for_each_packet(bytes, topic.type, topic.encoding, ref.utime, where,
                    [&](std::int64_t, std::string_view payload) {
                      if (!sensor) sensor = recognise_sensor(payload, options);
                    });
  }
  if (!sensor)
    throw Error("the packets of " + recording->describe(topic) + " are of no sensor that is known",
                recording->path(),
                "Known are Velodyne, Ouster and Hesai; record the driver's point cloud instead.");
  const auto damaged = std::make_shared<std::atomic<std::size_t>>(0);
  const auto read_packets = [recording, refs, damaged, type = topic.type, encoding = topic.encoding, where](
                                std::uint64_t first, std::uint64_t last, const UsePacket& use) {
    MessageBytes own;
    for (std::uint64_t m = first >> kPacketBits; m < refs->size() && m <= last >> kPacketBits; ++m) {
      const MessageRef& ref = (*refs)[static_cast<std::size_t>(m)];
      std::uint64_t key = m << kPacketBits;
      try {
        for_each_packet(recording->read(ref, kMaxFileBytes, own), type, encoding, ref.utime, where,
                        [&](std::int64_t received_us, std::string_view payload) {
                          if (key >= first && key <= last) use(received_us, key, payload);
                          ++key;
                        });
      } catch (const Error&) {
        ++*damaged;  // its packets count as lost
      }
    }
  };
  set_packet_scans(sensor, read_packets, drive);
  if (*damaged > 0)
    drive.warnings.push_back(std::to_string(*damaged) + " messages in " + where +
                             " are damaged: their packets are left out");
}

}  // namespace hp2
