// MCAP files (https://mcap.dev/spec): chunks plain, zstd or lz4; with and without indexes; whole or cut off.
#include <algorithm>
#include <map>
#include <set>
#include <unordered_map>

#include "common/error.hpp"
#include "player/readers/bags/chunked_file.hpp"

namespace hp2 {
namespace {

constexpr std::string_view kMagic("\x89MCAP0\r\n", 8);
constexpr std::size_t kRecordHead = 9;    // code and length
constexpr std::size_t kMessageHead = 22;  // of a message's content: channel, sequence, two times
constexpr std::size_t kChunkHead = 28;    // of a chunk's content up to its compression's name
constexpr std::size_t kMaxDescription = std::size_t{1} << 24;
enum : std::uint8_t {
  kFooter = 2,
  kSchema = 3,
  kChannel = 4,
  kMessage = 5,
  kChunk = 6,
  kMessageIndex = 7,
  kChunkIndex = 8,
  kDataEnd = 15
};

/// Takes numbers and strings off the front of a record's content; too few bytes make it fail.
struct Content {
  std::string_view bytes;
  bool good = true;

  template <typename T>
  T take() {
    const T value = little_endian<T>(bytes);
    skip(sizeof(T));
    return value;
  }
  void skip(std::uint64_t n) {
    good = good && n <= bytes.size();
    bytes.remove_prefix(good ? static_cast<std::size_t>(n) : bytes.size());
  }
  std::string_view take_string() {
    const auto n = take<std::uint32_t>();
    const std::string_view taken = bytes.substr(0, n);
    skip(n);
    return taken;
  }
};

std::int64_t us_of_ns(std::uint64_t ns) { return static_cast<std::int64_t>(ns / 1000); }

class Mcap final : public BagFile {
 public:
  Mcap(const PlainFile& file, const WantedTypes& wanted) : file_(file.file), wanted_(wanted) {
    if (file_.file().read(0, kMagic.size()) != kMagic)
      throw Error("not an MCAP file", file_.file().path(), "Give a file that an MCAP recorder has written.");
    read_summary();
    walk();
    for (BagTopic& topic : topics_) drop_repeated(topic);
  }

  std::string_view read(const MessageRef& ref, std::size_t most, MessageBytes& memory) const override {
    const auto fail = [&](const char* what) {
      throw Error(what, file_.where(ref.chunk), "Record it again, or repair it with `mcap recover`.");
    };
    const std::string_view head = file_.read(ref.chunk, ref.at, kRecordHead, memory);
    if (head.size() < kRecordHead) fail("a message's record is truncated");
    if (head[0] != kMessage) fail("the index points to no message");
    const auto size = little_endian<std::uint64_t>(head.substr(1));
    if (size < kMessageHead || size > kMaxFileBytes) fail("a message's record is damaged");
    const std::size_t n = std::min(static_cast<std::size_t>(size) - kMessageHead, most);
    const std::string_view data = file_.read(ref.chunk, ref.at + kRecordHead + kMessageHead, n, memory);
    if (data.size() < n) fail("a message's record is truncated");
    return data;
  }

 private:
  /// Schemas, channels and chunks as the summary at the end of a closed file lists them.
  void read_summary() {
    const std::uint64_t size = file_.file().size();
    constexpr std::uint64_t kTail = kRecordHead + 20 + 8;
    if (size < kTail) return;
    const std::string tail = file_.file().read(size - kTail, kTail);
    if (tail[0] != kFooter || std::string_view(tail).substr(kTail - 8) != kMagic) return;
    closed_ = true;
    const auto summary_at = little_endian<std::uint64_t>(std::string_view(tail).substr(kRecordHead));
    if (summary_at < kMagic.size()) return;
    RecordWindow window(file_, 0);
    std::uint64_t at = summary_at;
    while (at < size) {
      const std::string_view head = window.at(at, kRecordHead);
      if (head.size() < kRecordHead) return;
      const auto code = static_cast<std::uint8_t>(head[0]);
      const auto length = little_endian<std::uint64_t>(head.substr(1));
      if (length > size - at || code == kFooter) return;
      if (code == kSchema || code == kChannel) add_description(window, code, at + kRecordHead, length);
      if (code == kChunkIndex) {
        const std::string_view entry = window.at(at + kRecordHead, 24);
        if (entry.size() == 24) chunks_at_.insert(little_endian<std::uint64_t>(entry.substr(16)));
      }
      at += kRecordHead + length;
    }
  }

  /// A schema or a channel.
  void add_description(RecordWindow& window, std::uint8_t code, std::uint64_t at, std::uint64_t length) {
    // Only a schema's name matters, which comes first; a channel is short.
    Content content{
        window.at(at, static_cast<std::size_t>(std::min<std::uint64_t>(length, kMaxDescription)))};
    const auto id = content.take<std::uint16_t>();
    if (code == kSchema) {
      const std::string name(content.take_string());
      if (content.good) schemas_.emplace(id, name);
      return;
    }
    const auto schema = content.take<std::uint16_t>();
    const std::string topic(content.take_string());
    const std::string_view encoding = content.take_string();
    if (!content.good || channels_.count(id)) return;
    const Encoding known = encoding == "cdr"    ? Encoding::kCdr
                           : encoding == "ros1" ? Encoding::kRos1
                                                : Encoding::kOther;
    const auto type = schemas_.find(schema);
    const std::string name = type == schemas_.end() ? std::string() : type->second;
    channels_[id] = topic_index(topics_, topic,
                                known == Encoding::kOther ? name + " (" + std::string(encoding) + ")" : name,
                                known, wanted_);
  }

  /// A message, channel or schema at `at`, in a chunk or outside of any.
  void add_record(RecordWindow& window, std::uint8_t code, std::uint64_t at, std::uint64_t length,
                  std::uint32_t chunk) {
    if (code == kSchema || code == kChannel) add_description(window, code, at + kRecordHead, length);
    if (code != kMessage || length < kMessageHead) return;
    Content content{window.at(at + kRecordHead, kMessageHead)};
    const auto channel = channels_.find(content.take<std::uint16_t>());
    content.skip(4);
    const std::int64_t utime = us_of_ns(content.take<std::uint64_t>());
    if (channel != channels_.end() && content.good)
      add_message(topics_[channel->second], {utime, at, chunk, 0});
  }

  /// Messages of one channel of the newest chunk.
  void add_index(RecordWindow& window, std::uint64_t at, std::uint64_t length) {
    const std::string_view head = window.at(at, 6);
    if (head.size() < 6) return;
    const auto id = little_endian<std::uint16_t>(head);
    const auto bytes = little_endian<std::uint32_t>(head.substr(2));
    if (bytes == 0) return;
    const auto channel = channels_.find(id);
    if (channel == channels_.end() || bytes + std::uint64_t{6} > length) {
      unknown_channel_ = true;  // the chunk's own error reports it
      return;
    }
    for (std::uint64_t i = 0; i + 16 <= bytes; i += 16) {
      const std::string_view entry = window.at(at + 6 + i, 16);
      if (entry.size() < 16) return;
      pending_.emplace_back(channel->second,
                            MessageRef{us_of_ns(little_endian<std::uint64_t>(entry)),
                                       little_endian<std::uint64_t>(entry.substr(8)), chunk_, 0});
    }
    indexed_ = true;
  }

  /// The newest chunk's messages: from its index if that is whole, else from the chunk itself.
  void finish_chunk(bool whole) {
    if (chunk_ == 0) return;
    if (indexed_ && !unknown_channel_ && whole) {
      for (const auto& [topic, ref] : pending_) add_message(topics_[topic], ref);
    } else {
      scan_chunk();
    }
    pending_.clear();
    chunk_ = 0;
    indexed_ = unknown_channel_ = false;
  }

  void scan_chunk() {
    MessageBytes memory;
    std::uint64_t size = 0;
    try {
      size = file_.expanded_size(chunk_, memory);
    } catch (const Error& error) {
      warnings_.emplace_back(error.what());
      return;
    }
    RecordWindow window(file_, chunk_);
    std::uint64_t at = 0;
    while (at < size) {
      const std::string_view head = window.at(at, kRecordHead);
      if (head.size() < kRecordHead) break;
      const auto code = static_cast<std::uint8_t>(head[0]);
      const auto length = little_endian<std::uint64_t>(head.substr(1));
      if (length > size - at - kRecordHead) break;
      add_record(window, code, at, length, chunk_);
      at += kRecordHead + length;
    }
    if (at < size || size < file_.chunk(chunk_).expanded)
      warnings_.push_back(file_.where(chunk_) + " is damaged or ends early: what follows in it is left out");
  }

  void begin_chunk(RecordWindow& window, std::uint64_t at, std::uint64_t length) {
    Content content{window.at(at, kChunkHead)};
    content.skip(16);
    Chunk chunk;
    chunk.expanded = content.take<std::uint64_t>();
    chunk.crc = content.take<std::uint32_t>();
    const auto name_size = content.good ? little_endian<std::uint32_t>(window.at(at + kChunkHead, 4)) : 0;
    if (!content.good || name_size > 64) return;
    content = {window.at(at + kChunkHead, 4 + name_size + std::size_t{8})};
    chunk.compression = compression_of_name(content.take_string());
    const auto size = content.take<std::uint64_t>();
    chunk.at = at + kChunkHead + 4 + name_size + 8;
    const std::uint64_t end = std::min(file_.file().size(), at + length);
    if (!content.good || chunk.at > end) return;
    chunk.size = std::min({size, end - chunk.at, std::uint64_t{kMaxFileBytes}});
    // A plain chunk has the size that its bytes have.
    if (chunk.compression == Compression::kNone) chunk.expanded = std::max(chunk.expanded, chunk.size);
    if (chunk.size > 0) chunk_ = file_.add(chunk);
  }

  void walk() {
    const std::uint64_t size = file_.file().size();
    RecordWindow window(file_, 0);
    std::uint64_t at = kMagic.size();
    bool damaged = false;
    bool ended = false;
    while (at < size && !ended) {
      const std::string_view head = window.at(at, kRecordHead);
      const bool good = head.size() == kRecordHead && head[0] != 0;
      const auto code = good ? static_cast<std::uint8_t>(head[0]) : std::uint8_t{0};
      const auto length = little_endian<std::uint64_t>(head.substr(good ? 1 : head.size()));
      const bool whole = good && length <= size - at - kRecordHead;
      if (good && code == kChunk) {
        finish_chunk(true);
        begin_chunk(window, at + kRecordHead, std::min(length, size - at - kRecordHead));
      }
      if (!whole) {
        const auto next = chunks_at_.upper_bound(at);
        const bool last = next == chunks_at_.end() || *next >= size;
        warnings_.push_back(file_.file().path() + " is damaged or ends early at byte " + std::to_string(at) +
                            (last ? ": what follows is left out" : ": the rest of this chunk is left out"));
        damaged = true;
        if (last) break;
        finish_chunk(false);
        at = *next;
        continue;
      }
      if (code == kMessageIndex && chunk_ != 0) {
        add_index(window, at + kRecordHead, length);
      } else if (code != kChunk) {
        finish_chunk(true);
        add_record(window, code, at, length, 0);
      }
      ended = code == kDataEnd || code == kFooter;
      at += kRecordHead + length;
    }
    finish_chunk(!damaged && ended);
    if (!closed_ && !damaged)
      warnings_.push_back(file_.file().path() + " was not closed when it was recorded, or ends early");
  }

  ChunkedFile file_;
  WantedTypes wanted_;
  bool closed_ = false;
  std::set<std::uint64_t> chunks_at_;  ///< As the summary lists them.
  std::unordered_map<std::uint16_t, std::string> schemas_;
  std::unordered_map<std::uint16_t, std::size_t> channels_;  ///< To the topic.
  // The newest chunk while the file is walked through; 0: none.
  std::uint32_t chunk_ = 0;
  bool indexed_ = false, unknown_channel_ = false;
  std::vector<std::pair<std::size_t, MessageRef>> pending_;
};

}  // namespace

std::unique_ptr<BagFile> open_mcap(const PlainFile& file, const WantedTypes& wanted) {
  return std::make_unique<Mcap>(file, wanted);
}

}  // namespace hp2
