// ROS 1 bags (format 2.0) with sensor_msgs/PointCloud2. Chunks without compression are always read; bz2 and
// lz4 if the project is configured with HP2_WITH_ROSBAG.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <memory>
#include <set>

#ifdef HP2_WITH_ROSBAG
#include <bzlib.h>
#include <lz4frame.h>
#endif

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/point_cloud2.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMaxHeader = 1 << 20;
constexpr std::size_t kMaxChunk = 1 << 28;
constexpr std::size_t kStampEnd = 12;  // of a message: its number and stamp
constexpr char kOpMessage = 2, kOpIndex = 4, kOpChunk = 5, kOpConnection = 7;

[[noreturn]] void fail(const std::string& what, const std::string& where) {
  throw Error(what, where, "Run `rosbag check` or `rosbag reindex` on the bag.");
}

template <typename T>
T little_endian(std::string_view bytes) {
  T value{};
  if (bytes.size() >= sizeof(T)) std::memcpy(&value, bytes.data(), sizeof(T));
  return value;
}

using Fields = std::map<std::string, std::string>;

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

/// [us] of a ROS time: seconds, then nanoseconds.
std::int64_t ros_time(std::string_view bytes) {
  if (bytes.size() < 8) return 0;
  return static_cast<std::int64_t>(little_endian<std::uint32_t>(bytes)) * 1'000'000 +
         little_endian<std::uint32_t>(bytes.substr(4)) / 1000;
}

struct Chunk {
  std::uint64_t at = 0;    ///< Of its data in the bag.
  std::uint32_t size = 0;  ///< As stored.
  std::uint32_t expanded = 0;
  std::string compression;
};

struct MessageRef {
  std::int64_t utime = 0;  ///< When it was recorded.
  std::uint32_t connection = 0;
  std::size_t chunk = 0;
  std::uint32_t offset = 0;  ///< In the expanded chunk.
};

struct Bag {
  explicit Bag(const std::string& path) : file(path) {}
  PartFile file;
  std::vector<Chunk> chunks;
  std::vector<MessageRef> messages;
  std::map<std::uint32_t, Fields> connections;  ///< Topic and type.
  std::string warning;
};

void add_index(Bag& bag, const Fields& header, const std::string& data) {
  if (bag.chunks.empty() || header.count("conn") == 0) return;
  MessageRef ref;
  ref.connection = little_endian<std::uint32_t>(header.at("conn"));
  ref.chunk = bag.chunks.size() - 1;
  for (std::size_t i = 0; i + 12 <= data.size(); i += 12) {
    const std::string_view entry = std::string_view(data).substr(i, 12);
    ref.utime = ros_time(entry);
    ref.offset = little_endian<std::uint32_t>(entry.substr(8));
    bag.messages.push_back(ref);
  }
}

/// Walks the records of the bag; chunks are passed over.
void read_index(Bag& bag) {
  std::uint64_t at = 13;  // after "#ROSBAG V2.0\n"
  if (bag.file.read(0, 13) != "#ROSBAG V2.0\n") fail("not a ROS bag of format 2.0", bag.file.path());
  while (at < bag.file.size()) {
    const auto header_size = little_endian<std::uint32_t>(bag.file.read(at, 4));
    if (header_size > kMaxHeader || at + 8 + header_size > bag.file.size()) break;
    const std::string head = bag.file.read(at + 4, header_size + 4);
    const Fields header = parse_fields(std::string_view(head).substr(0, header_size));
    const auto data_size = little_endian<std::uint32_t>(std::string_view(head).substr(header_size));
    const std::uint64_t data_at = at + 8 + header_size;
    if (data_at + data_size > bag.file.size()) break;
    const auto op = header.find("op");
    const char code = op == header.end() || op->second.empty() ? '\0' : op->second[0];
    if (code == kOpChunk) {
      const auto get = [&](const char* key) { return header.count(key) ? header.at(key) : std::string(); };
      bag.chunks.push_back(
          {data_at, data_size, little_endian<std::uint32_t>(get("size")), get("compression")});
    } else if (code == kOpIndex) {
      add_index(bag, header, bag.file.read(data_at, data_size));
    } else if (code == kOpConnection && header.count("conn") && header.count("topic")) {
      Fields connection =
          parse_fields(bag.file.read(data_at, std::min<std::uint32_t>(data_size, kMaxHeader)));
      connection["topic"] = header.at("topic");
      bag.connections[little_endian<std::uint32_t>(header.at("conn"))] = connection;
    }
    at = data_at + data_size;
  }
  if (at < bag.file.size())
    bag.warning = bag.file.path() + " is damaged or ends early at byte " + std::to_string(at) +
                  ": what follows is left out";
}

/// Keeps the PointCloud2 messages of the one topic that is asked for, in order of time.
void choose_topic(Bag& bag, const std::string& wanted) {
  std::set<std::string> topics;
  for (const auto& [id, c] : bag.connections)
    if (c.count("type") && c.at("type") == "sensor_msgs/PointCloud2") topics.insert(c.at("topic"));
  if (bag.connections.empty()) fail("the bag was not closed: it has no index", bag.file.path());
  std::string list;
  for (const std::string& topic : topics) list += (list.empty() ? "" : ", ") + topic;
  if (topics.empty())
    throw Error("the bag has no sensor_msgs/PointCloud2", bag.file.path(),
                "Convert the driver's packets first.");
  if (!wanted.empty() && topics.count(wanted) == 0)
    throw Error("the bag has no PointCloud2 on this topic", wanted, "It has: " + list + ".");
  if (wanted.empty() && topics.size() > 1)
    throw Error("the bag has several PointCloud2 topics", bag.file.path(),
                "Name one with --topic: " + list + ".");
  const std::string topic = wanted.empty() ? *topics.begin() : wanted;
  const auto is_other = [&](const MessageRef& m) {
    const auto it = bag.connections.find(m.connection);
    return it == bag.connections.end() || it->second.at("topic") != topic || it->second.count("type") == 0 ||
           it->second.at("type") != "sensor_msgs/PointCloud2";
  };
  bag.messages.erase(std::remove_if(bag.messages.begin(), bag.messages.end(), is_other), bag.messages.end());
  std::stable_sort(bag.messages.begin(), bag.messages.end(),
                   [](const MessageRef& a, const MessageRef& b) { return a.utime < b.utime; });
}

#ifdef HP2_WITH_ROSBAG
/// Expands into a buffer that grows with what really comes out, whatever the header claims.
std::string expand(const std::string& packed, const Chunk& chunk, const std::string& where) {
  std::string out;
  const auto grow = [&](std::size_t used) {
    if (used >= chunk.expanded) fail("a chunk is larger than its header says", where);
    out.resize(std::min<std::size_t>(std::max<std::size_t>(2 * used, 65536), chunk.expanded));
  };
  std::size_t used = 0;
  bool done = false;
  if (chunk.compression == "bz2") {
    bz_stream stream{};
    if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) fail("bzip2 does not start", where);
    const std::unique_ptr<bz_stream, int (*)(bz_stream*)> owner(&stream, BZ2_bzDecompressEnd);
    stream.next_in = const_cast<char*>(packed.data());
    stream.avail_in = static_cast<unsigned>(packed.size());
    while (!done) {
      if (used == out.size()) grow(used);
      stream.next_out = out.data() + used;
      stream.avail_out = static_cast<unsigned>(out.size() - used);
      const int code = BZ2_bzDecompress(&stream);
      const std::size_t now = out.size() - stream.avail_out;
      done = code == BZ_STREAM_END;
      if (!done && (code != BZ_OK || (now == used && stream.avail_in == 0)))
        fail("a bz2 chunk is damaged", where);
      used = now;
    }
  } else {
    LZ4F_dctx* context = nullptr;
    if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION)))
      fail("lz4 does not start", where);
    const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> owner(context,
                                                                             LZ4F_freeDecompressionContext);
    std::size_t in = 0;
    while (!done) {
      if (used == out.size()) grow(used);
      std::size_t produced = out.size() - used;
      std::size_t consumed = packed.size() - in;
      const std::size_t hint =
          LZ4F_decompress(context, out.data() + used, &produced, packed.data() + in, &consumed, nullptr);
      if (LZ4F_isError(hint) || (hint != 0 && produced == 0 && consumed == 0))
        fail("an lz4 chunk is damaged", where);
      used += produced;
      in += consumed;
      done = hint == 0;
    }
  }
  out.resize(used);
  return out;
}
#endif

/// The data of a message out of its chunk, `most` bytes at most.
std::string read_message(const Bag& bag, const MessageRef& ref, std::size_t most = kMaxFileBytes) {
  const Chunk& chunk = bag.chunks.at(ref.chunk);
  const std::string where = bag.file.path() + ", chunk at byte " + std::to_string(chunk.at);
  std::string expanded;
  const bool stored = chunk.compression == "none";
  if (!stored) {
#ifdef HP2_WITH_ROSBAG
    if (chunk.compression != "bz2" && chunk.compression != "lz4")
      fail("unknown compression '" + chunk.compression + "'", where);
    if (chunk.expanded > kMaxChunk) fail("a chunk of an impossible size", where);
    expanded = expand(bag.file.read(chunk.at, chunk.size), chunk, where);
#else
    throw Error("the bag is compressed (" + chunk.compression + ")", bag.file.path(),
                "Run `rosbag decompress` on it, or configure the build with -DHP2_WITH_ROSBAG=ON.");
#endif
  }
  const std::uint64_t size = stored ? chunk.size : expanded.size();
  const auto part = [&](std::uint64_t offset, std::size_t n) {
    if (offset > size || n > size - offset) fail("a message's record is truncated", where);
    return stored ? bag.file.read(chunk.at + offset, n) : expanded.substr(offset, n);
  };
  const auto header_size = little_endian<std::uint32_t>(part(ref.offset, 4));
  if (header_size > kMaxHeader) fail("a message's record is damaged", where);
  const std::string head = part(ref.offset + std::uint64_t{4}, header_size + std::size_t{4});
  const Fields fields = parse_fields(std::string_view(head).substr(0, header_size));
  const auto op = fields.find("op");
  if (op == fields.end() || op->second != std::string(1, kOpMessage))
    fail("the index points to no message", where);
  const auto data_size = little_endian<std::uint32_t>(std::string_view(head).substr(header_size));
  const std::uint64_t data_at = ref.offset + std::uint64_t{8} + header_size;
  if (data_at + data_size > size) fail("a message's record is truncated", where);
  return part(data_at, std::min<std::size_t>(data_size, most));
}

}  // namespace

Drive open_rosbag(const std::string& path, const SourceOptions& options) {
  const auto bag = std::make_shared<Bag>(path);
  read_index(*bag);
  choose_topic(*bag, options.topic);
  Drive drive;
  drive.info = {stem(base_name(path)), "rosbag", "", path};
  if (!bag->warning.empty()) drive.warnings.push_back(bag->warning);
  if (bag->messages.empty()) throw Error("the bag holds no scan", path, "Choose another topic with --topic.");

  // The header's stamps say when the sweeps began; the times of recording only bound them. Reading all of a
  // compressed bag for its stamps would take too long: there the times of recording must do.
  std::vector<double> times;
  for (const MessageRef& ref : bag->messages) {
    std::int64_t stamp = -1;
    try {
      if (bag->chunks.at(ref.chunk).compression == "none")
        stamp = point_cloud2_stamp(read_message(*bag, ref, 12));
    } catch (const Error&) {
      // A damaged scan is reported when it is its turn to be read.
    }
    times.push_back(stamp >= 0 ? static_cast<double>(stamp) * 1e-6
                               : std::numeric_limits<double>::quiet_NaN());
  }
  const auto stamped = std::count_if(times.begin(), times.end(), [](double t) { return std::isfinite(t); });
  if (2 * static_cast<std::size_t>(stamped) < times.size())
    for (std::size_t i = 0; i < times.size(); ++i)
      times[i] = static_cast<double>(bag->messages[i].utime) * 1e-6;
  MendOptions mend;
  mend.same_points = [&bag](std::size_t a, std::size_t b) {
    return read_message(*bag, bag->messages[a]).substr(kStampEnd) ==
           read_message(*bag, bag->messages[b]).substr(kStampEnd);
  };
  MendedStamps clock = mend_stamps(times, "the messages' headers in " + path, mend);
  drive.warnings.insert(drive.warnings.end(), clock.warnings.begin(), clock.warnings.end());
  std::vector<MessageRef> kept;
  for (const std::size_t i : clock.order) kept.push_back(bag->messages[i]);
  bag->messages = std::move(kept);
  const std::vector<std::int64_t>& stamps = clock.stamps_us;
  const TimeSamples samples = sample_times(stamps, [&bag, &path](std::size_t i, PointFile& file) {
    parse_point_cloud2(read_message(*bag, bag->messages[i]), path, file);
  });
  TimeUnit unit;
  const bool has_times = !samples.raw.empty();
  if (has_times) unit = find_time_unit(samples.raw, estimate_sweep(stamps), 0.0, samples.stamps_us);
  drive.time_in_sweep = has_times ? describe(unit) : "";
  for (std::size_t i = 0; i < stamps.size(); ++i)
    drive.scans.push_back({path, stamps[i] + unit.start_us, unit.duration_us, static_cast<std::int64_t>(i)});
  drive.decode = [bag, unit, has_times](const DriveScan& entry, Scan& scan) {
    PointFile file;
    const auto index = static_cast<std::size_t>(entry.key);
    parse_point_cloud2(read_message(*bag, bag->messages[index]),
                       entry.path + ", message " + std::to_string(index), file);
    move_points(file, scan);
    if (has_times) apply_times(file.raw_time, unit, scan);
  };
  return drive;
}

}  // namespace hp2
