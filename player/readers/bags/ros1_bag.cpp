// ROS 1 bags, format 2.0: closed or not, chunks plain, lz4 or bz2.
#include <algorithm>
#include <map>
#include <set>

#include "common/error.hpp"
#include "player/readers/bags/chunked_file.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMaxHeader = 1 << 20;
constexpr char kOpMessage = 2, kOpBagHeader = 3, kOpIndex = 4, kOpChunk = 5, kOpChunkInfo = 6,
               kOpConnection = 7;
constexpr std::string_view kMagic = "#ROSBAG V2.0\n";

using Fields = std::map<std::string, std::string, std::less<>>;

/// The name=value fields of a record's header. Damaged ones end the list.
Fields parse_fields(std::string_view bytes) {
  Fields fields;
  while (bytes.size() >= 4) {
    const auto size = little_endian<std::uint32_t>(bytes);
    bytes.remove_prefix(4);
    if (size > bytes.size()) break;
    const std::string_view field = bytes.substr(0, size);
    bytes.remove_prefix(size);
    const std::size_t equals = field.find('=');
    if (equals != std::string_view::npos)
      fields.emplace(std::string(field.substr(0, equals)), std::string(field.substr(equals + 1)));
  }
  return fields;
}

std::string_view value_of(const Fields& fields, std::string_view name) {
  const auto it = fields.find(name);
  return it == fields.end() ? std::string_view() : std::string_view(it->second);
}

/// [us] of a ROS time: seconds, then nanoseconds.
std::int64_t ros_time(std::string_view bytes) {
  if (bytes.size() < 8) return 0;
  return static_cast<std::int64_t>(little_endian<std::uint32_t>(bytes)) * 1'000'000 +
         little_endian<std::uint32_t>(bytes.substr(4)) / 1000;
}

/// A record's header; its data lies at [data_at, data_at + data_size) and may be cut off.
struct Record {
  char op = 0;
  Fields fields;
  std::uint64_t data_at = 0;
  std::uint32_t data_size = 0;
};

/// The record at `at`; false if there is none.
bool read_record(RecordWindow& window, std::uint64_t at, Record& record) {
  const std::string_view size = window.at(at, 4);
  const auto header_size = little_endian<std::uint32_t>(size);
  if (size.size() < 4 || header_size > kMaxHeader) return false;
  const std::string_view head = window.at(at + 4, header_size + std::size_t{4});
  if (head.size() < header_size + std::size_t{4}) return false;
  record.fields = parse_fields(head.substr(0, header_size));
  const std::string_view op = value_of(record.fields, "op");
  record.op = op.empty() ? '\0' : op[0];
  record.data_at = at + 8 + header_size;
  record.data_size = little_endian<std::uint32_t>(head.substr(header_size));
  return record.op != '\0';
}

class Ros1Bag final : public BagFile {
 public:
  Ros1Bag(const PlainFile& file, const WantedTypes& wanted) : file_(file.file), wanted_(wanted) {
    if (file_.file().read(0, kMagic.size()) != kMagic)
      throw Error("not a ROS bag of format 2.0", file_.file().path(),
                  "Give a bag that rosbag record has written.");
    read_end();
    walk();
    for (BagTopic& topic : topics_) drop_repeated(topic);
  }

  std::string_view read(const MessageRef& ref, std::size_t most, MessageBytes& memory) const override {
    const auto fail = [&](const char* what) {
      throw Error(what, file_.where(ref.chunk), "Record it again, or repair it with `rosbag reindex`.");
    };
    const auto header_size = little_endian<std::uint32_t>(file_.read(ref.chunk, ref.at, 4, memory));
    if (header_size > kMaxHeader) fail("a message's record is damaged");
    const std::string_view head = file_.read(ref.chunk, ref.at + 4, header_size + std::size_t{4}, memory);
    if (head.size() < header_size + std::size_t{4}) fail("a message's record is truncated");
    const Fields fields = parse_fields(head.substr(0, header_size));
    if (value_of(fields, "op") != std::string_view(&kOpMessage, 1)) fail("the index points to no message");
    const auto size = little_endian<std::uint32_t>(head.substr(header_size));
    const std::size_t n = std::min<std::size_t>(size, most);
    const std::string_view data = file_.read(ref.chunk, ref.at + 8 + header_size, n, memory);
    if (data.size() < n) fail("a message's record is truncated");
    return data;
  }

 private:
  /// Connections and chunks as the end of a closed bag lists them.
  void read_end() {
    RecordWindow window(file_, 0);
    Record record;
    if (!read_record(window, kMagic.size(), record) || record.op != kOpBagHeader) return;
    const auto index_at = little_endian<std::uint64_t>(value_of(record.fields, "index_pos"));
    closed_ = index_at > kMagic.size() && index_at < file_.file().size();
    const auto chunk_count = little_endian<std::uint32_t>(value_of(record.fields, "chunk_count"));
    if (closed_) list_records(window, index_at);
    closed_ = closed_ && !connections_.empty();
    // Without the index some writers' connections still stand outside of the chunks.
    if (!closed_) list_records(window, kMagic.size());
    if (closed_ && chunks_at_.size() < chunk_count)
      warnings_.push_back(file_.file().path() + " ends early: its index is not whole");
  }

  /// Connections and chunks in the records from `at` on.
  void list_records(RecordWindow& window, std::uint64_t at) {
    Record record;
    for (; at < file_.file().size() && read_record(window, at, record);
         at = record.data_at + record.data_size) {
      if (record.op == kOpConnection) add_connection(window, record);
      if (record.op == kOpChunkInfo)
        chunks_at_.insert(little_endian<std::uint64_t>(value_of(record.fields, "chunk_pos")));
    }
  }

  void add_connection(RecordWindow& window, const Record& record) {
    const std::string_view id = value_of(record.fields, "conn");
    const std::string topic(value_of(record.fields, "topic"));
    if (id.size() < 4 || topic.empty() || record.data_size > kMaxFileBytes) return;
    const auto number = little_endian<std::uint32_t>(id);
    if (connections_.count(number)) return;
    const Fields data = parse_fields(window.at(record.data_at, record.data_size));
    connections_[number] =
        topic_index(topics_, topic, std::string(value_of(data, "type")), Encoding::kRos1, wanted_);
  }

  /// Index entries of one connection of the newest chunk.
  void add_index(RecordWindow& window, const Record& record) {
    const auto connection = little_endian<std::uint32_t>(value_of(record.fields, "conn"));
    const auto it = connections_.find(connection);
    if (it == connections_.end()) {
      unknown_connection_ = true;  // the chunk's own error reports it
      return;
    }
    for (std::uint32_t i = 0; i + 12 <= record.data_size; i += 12) {
      const std::string_view entry = window.at(record.data_at + i, 12);
      if (entry.size() < 12) return;
      pending_.emplace_back(
          it->second, MessageRef{ros_time(entry), little_endian<std::uint32_t>(entry.substr(8)), chunk_, 0});
    }
    indexed_ = true;
  }

  /// The newest chunk's messages: from its index if that is whole, else from the chunk itself.
  void finish_chunk(bool whole) {
    if (chunk_ == 0) return;
    if (indexed_ && !unknown_connection_ && whole) {
      for (const auto& [topic, ref] : pending_) add_message(topics_[topic], ref);
    } else {
      scan_chunk();
    }
    pending_.clear();
    chunk_ = 0;
    indexed_ = unknown_connection_ = false;
  }

  /// Walks through the newest chunk record by record.
  void scan_chunk() {
    MessageBytes memory;
    std::uint64_t size = 0;
    try {
      size = file_.expanded_size(chunk_, memory);
    } catch (const Error& error) {
      warnings_.emplace_back(error.what());
      return;
    }
    const Chunk& chunk = file_.chunk(chunk_);
    RecordWindow window(file_, chunk_);
    Record record;
    std::uint64_t at = 0;
    while (at < size && read_record(window, at, record)) {
      const std::uint64_t end = record.data_at + record.data_size;
      if (end > size) break;
      add_record(window, record, at, chunk_);
      at = end;
    }
    if (at < size || (chunk.compression != Compression::kNone && size < chunk.expanded))
      warnings_.push_back(file_.where(chunk_) + " is damaged or ends early: what follows in it is left out");
  }

  /// A message or connection, in a chunk or outside of any.
  void add_record(RecordWindow& window, const Record& record, std::uint64_t at, std::uint32_t chunk) {
    if (record.op == kOpConnection) add_connection(window, record);
    if (record.op != kOpMessage) return;
    const auto it = connections_.find(little_endian<std::uint32_t>(value_of(record.fields, "conn")));
    if (it != connections_.end())
      add_message(topics_[it->second], {ros_time(value_of(record.fields, "time")), at, chunk, 0});
  }

  void begin_chunk(const Record& record, std::uint64_t left) {
    Chunk chunk;
    chunk.at = record.data_at;
    chunk.compression = compression_of_name(value_of(record.fields, "compression"));
    chunk.expanded = little_endian<std::uint32_t>(value_of(record.fields, "size"));
    chunk.size = std::min<std::uint64_t>(record.data_size, left);
    // A recorder that was killed has left the sizes of its last chunk open.
    if (record.data_size == 0 && chunk.compression != Compression::kNone) chunk.size = left;
    if (chunk.size > kMaxFileBytes) chunk.size = kMaxFileBytes;
    if (chunk.size > 0) chunk_ = file_.add(chunk);
  }

  void walk() {
    const std::uint64_t size = file_.file().size();
    RecordWindow window(file_, 0);
    Record record;
    std::uint64_t at = kMagic.size();
    bool damaged = false;
    while (at < size) {
      const bool good = read_record(window, at, record);
      const std::uint64_t end = record.data_at + record.data_size;
      if (good && record.op == kOpChunk) {
        finish_chunk(true);
        begin_chunk(record, size - std::min(size, record.data_at));
        if (chunk_ != 0 && record.data_size == 0) {  // the rest of the file is this chunk
          damaged = true;
          break;
        }
      }
      if (!good || end > size) {
        const auto next = chunks_at_.upper_bound(at);
        warnings_.push_back(file_.file().path() + " is damaged or ends early at byte " + std::to_string(at) +
                            (next == chunks_at_.end() ? ": what follows is left out"
                                                      : ": the rest of this chunk is left out"));
        damaged = true;
        if (next == chunks_at_.end()) break;
        finish_chunk(false);
        at = *next;
        continue;
      }
      if (record.op == kOpIndex && chunk_ != 0) {
        add_index(window, record);
      } else if (record.op != kOpChunk) {
        finish_chunk(true);
        add_record(window, record, at, 0);
      }
      at = end;
    }
    finish_chunk(!damaged && closed_);
    if (!closed_ && !damaged)
      warnings_.push_back(file_.file().path() +
                          " was not closed when it was recorded: it is read without its index");
  }

  ChunkedFile file_;
  WantedTypes wanted_;
  bool closed_ = false;
  std::set<std::uint64_t> chunks_at_;                 ///< As the end of the bag lists them.
  std::map<std::uint32_t, std::size_t> connections_;  ///< Number to topic.
  // The newest chunk while the bag is walked through; 0: none.
  std::uint32_t chunk_ = 0;
  bool indexed_ = false, unknown_connection_ = false;
  std::vector<std::pair<std::size_t, MessageRef>> pending_;
};

}  // namespace

std::unique_ptr<BagFile> open_ros1_bag(const PlainFile& file, const WantedTypes& wanted) {
  return std::make_unique<Ros1Bag>(file, wanted);
}

}  // namespace hp2
