// Logs of lcm-logger that hold our scans: whole (scan_t) or in pieces (chunk_t of a scan_t).
#include <algorithm>
#include <cstring>
#include <hp2/chunk_t.hpp>
#include <hp2/scan_t.hpp>
#include <map>
#include <memory>
#include <set>
#include <tuple>

#include "common/error.hpp"
#include "common/time_unit.hpp"
#include "common/transport/convert.hpp"
#include "common/transport/crc32.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/same_content.hpp"
#include "player/sweep/stamp_mender.hpp"

namespace hp2 {
namespace {

constexpr std::uint32_t kSync = 0xeda1da01U;
constexpr std::size_t kEventHeader =
    28;  // sync, number, time, length of the channel's name, length of the data
constexpr std::size_t kChunkHeader = 56;  // fingerprint and chunk_t's fields before the data
constexpr std::size_t kScanHeader = 128;  // of a scan_t: what a relay may change, such as its number
constexpr std::int64_t kLongestSweep_us = 10'000'000;
constexpr std::int32_t kMaxPieces = 1 << 20;

template <typename T>
T big_endian(const char* p) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value = value << 8 | static_cast<unsigned char>(p[i]);
  return static_cast<T>(value);
}

/// Overwrites a field of a message, if it is that long.
void put_big_endian(std::int64_t value, std::string& bytes, std::size_t at) {
  if (bytes.size() < at + sizeof(value)) return;
  for (std::size_t i = 0; i < sizeof(value); ++i)
    bytes[at + i] = static_cast<char>(static_cast<std::uint64_t>(value) >> (56 - 8 * i));
}

/// Bytes of one piece of a message in the log.
struct Piece {
  std::uint64_t at = 0;
  std::uint32_t size = 0;
  std::int32_t offset = 0;  ///< In the message.
  std::int32_t index = 0;   ///< Of so many pieces.
};

/// A scan's message as it lies in the log.
struct Message {
  std::string channel;
  std::vector<Piece> pieces;  ///< As they came; in order, each once, when the log was read.
  std::int32_t count = 1;
  std::int32_t total = 0;
  std::int32_t crc = 0;
  bool has_crc = false;

  bool complete() const { return pieces.size() == static_cast<std::size_t>(count); }
};

struct Index {
  std::vector<std::shared_ptr<Message>> messages;  ///< In order of their first pieces.
  std::map<std::tuple<std::string, std::int64_t, std::int64_t>, std::shared_ptr<Message>> by_number;
  std::string warning;
};

/// Takes note of one piece. Pieces that came twice, or do not fit their message, are left out.
void add_piece(Index& index, const std::string& channel, const char* head, std::uint64_t data_at,
               std::uint32_t data_size) {
  const auto session = big_endian<std::int64_t>(head + 8);
  const auto number = big_endian<std::int64_t>(head + 24);
  const auto piece = big_endian<std::int32_t>(head + 32);
  const auto count = big_endian<std::int32_t>(head + 36);
  const auto total = big_endian<std::int32_t>(head + 40);
  const auto offset = big_endian<std::int32_t>(head + 44);
  const auto crc = big_endian<std::int32_t>(head + 48);
  const auto size = big_endian<std::int32_t>(head + 52);
  if (count < 1 || count > kMaxPieces || piece < 0 || piece >= count || total < 1 || size < 0 || offset < 0 ||
      offset > total - size || static_cast<std::uint32_t>(size) != data_size - kChunkHeader)
    return;
  auto& message = index.by_number[{channel, session, number}];
  if (!message) {
    message = std::make_shared<Message>();
    message->channel = channel;
    message->count = count;
    message->total = total;
    message->crc = crc;
    message->has_crc = true;
    index.messages.push_back(message);
  }
  if (message->count != count || message->total != total || message->crc != crc) return;
  message->pieces.push_back({data_at + kChunkHeader, static_cast<std::uint32_t>(size), offset, piece});
}

/// Puts a message's pieces in order; of those that came twice the first counts.
void sort_pieces(Message& message) {
  auto& pieces = message.pieces;
  const auto before = [](const Piece& a, const Piece& b) { return a.index < b.index; };
  if (!std::is_sorted(pieces.begin(), pieces.end(), before))
    std::stable_sort(pieces.begin(), pieces.end(), before);
  const auto same = [](const Piece& a, const Piece& b) { return a.index == b.index; };
  pieces.erase(std::unique(pieces.begin(), pieces.end(), same), pieces.end());
}

Index build_index(const PartFile& log) {
  Index index;
  const auto scan_hash = scan_t::getHash();
  const auto chunk_hash = chunk_t::getHash();
  std::uint64_t at = 0;
  while (at < log.size()) {
    const std::string head = log.read(at, kEventHeader + 64 + kChunkHeader);
    if (head.size() < kEventHeader || big_endian<std::uint32_t>(head.data()) != kSync) break;
    const auto name_size = big_endian<std::uint32_t>(head.data() + 20);
    const auto data_size = big_endian<std::uint32_t>(head.data() + 24);
    if (name_size > 63 || at + kEventHeader + name_size + data_size > log.size()) break;
    const std::string channel = head.substr(kEventHeader, name_size);
    const std::uint64_t data_at = at + kEventHeader + name_size;
    const char* data = head.data() + kEventHeader + name_size;
    const auto hash = data_size >= 8 ? big_endian<std::int64_t>(data) : 0;
    if (hash == scan_hash) {
      auto message = std::make_shared<Message>();
      message->channel = channel;
      message->pieces = {{data_at, data_size, 0, 0}};
      message->total = static_cast<std::int32_t>(std::min<std::uint32_t>(data_size, INT32_MAX));
      index.messages.push_back(std::move(message));
    } else if (hash == chunk_hash && data_size >= kChunkHeader) {
      add_piece(index, channel, data, data_at, data_size);
    }
    at = data_at + data_size;
  }
  for (const auto& message : index.messages) sort_pieces(*message);
  if (at < log.size())
    index.warning =
        log.path() + " is damaged or ends early at byte " + std::to_string(at) + ": what follows is left out";
  return index;
}

/// The whole message, put together. @throws Error if it does not fit its checksum
std::string assemble(const PartFile& log, const Message& message) {
  std::string bytes;
  for (const Piece& piece : message.pieces) {
    if (static_cast<std::size_t>(piece.offset) != bytes.size()) break;
    bytes += log.read(piece.at, piece.size);
  }
  const bool whole = bytes.size() == static_cast<std::size_t>(message.total);
  if (!whole ||
      (message.has_crc && static_cast<std::int32_t>(crc32(bytes.data(), bytes.size())) != message.crc))
    throw Error("a scan's message is damaged",
                log.path() + ", byte " + std::to_string(message.pieces.front().at), "Record the log again.");
  return bytes;
}

/// Keeps the complete scans of the one channel that is asked for.
void choose_channel(Index& index, const std::string& wanted, const PartFile& log,
                    std::vector<std::string>& warnings) {
  auto& messages = index.messages;
  // Pieces of other messages travel as chunk_t, too: only those that begin with a scan_t's fingerprint are
  // scans.
  std::set<std::string> scan_channels;
  for (const auto& m : messages) {
    if (m->pieces[0].index != 0 || scan_channels.count(m->channel)) continue;
    const std::string hash = log.read(m->pieces[0].at, 8);
    if (hash.size() == 8 && big_endian<std::int64_t>(hash.data()) == scan_t::getHash())
      scan_channels.insert(m->channel);
  }
  if (!wanted.empty() && scan_channels.count(wanted) == 0)
    throw Error("the log has no scans on this channel", wanted,
                "Leave it away to see which channels it has.");
  if (wanted.empty() && scan_channels.size() > 1) {
    std::string list;
    for (const std::string& channel : scan_channels) list += (list.empty() ? "" : ", ") + channel;
    throw Error("the log has scans on several channels", log.path(), "Name one with --topic: " + list + ".");
  }
  const std::string channel = wanted.empty() && !scan_channels.empty() ? *scan_channels.begin() : wanted;
  std::size_t incomplete = 0;
  const auto unusable = [&](const std::shared_ptr<Message>& m) {
    if (m->channel != channel) return true;
    incomplete += !m->complete();
    return !m->complete();
  };
  messages.erase(std::remove_if(messages.begin(), messages.end(), unusable), messages.end());
  if (incomplete > 0)
    warnings.push_back(std::to_string(incomplete) + " scans in " + log.path() +
                       " lack pieces: they are left out");
}

/// Seconds of the unit of utime, which should be 1e-6.
double unit_of_utime(const std::vector<double>& utimes, const std::string& path,
                     std::vector<std::string>& warnings) {
  const double unit = unit_of_stamps(utimes);
  if (unit == 0.0 || unit == 1e-6) return 1e-6;
  warnings.push_back(path + ": scan_t.utime is in " + name_of_unit(unit) +
                     " and is read as such; the driver should write microseconds");
  return unit;
}

}  // namespace

Drive open_lcm_log(const std::string& path, const SourceOptions& options) {
  const auto log = std::make_shared<const PartFile>(path);
  Index index = build_index(*log);
  Drive drive;
  drive.info = {stem(base_name(path)), "lcm-log", "", path};
  if (!index.warning.empty()) drive.warnings.push_back(index.warning);
  choose_channel(index, options.topic, *log, drive.warnings);
  if (index.messages.empty())
    throw Error("the log holds no scan", path, "Record HP2_SCAN or HP2_CHUNK_SCAN with lcm-logger.");
  std::vector<double> starts;  // as the driver wrote them
  std::vector<std::int64_t> durations;
  for (const auto& message : index.messages) {
    const Piece& first = message->pieces.front();
    const std::string head =
        log->read(first.at, std::min<std::size_t>(first.size, 24));  // fingerprint, utime, duration
    const bool good = head.size() == 24;
    starts.push_back(good ? static_cast<double>(big_endian<std::int64_t>(head.data() + 8)) : NAN);
    const std::int64_t duration = good ? big_endian<std::int64_t>(head.data() + 16) : 0;
    durations.push_back(duration);
  }
  const double unit = unit_of_utime(starts, path, drive.warnings);
  for (double& start : starts) start *= unit;
  for (std::int64_t& duration : durations) {
    if (duration > kLongestSweep_us && unit == 1e-9) duration /= 1000;  // of the same wrong unit
    if (duration < 0 || duration > kLongestSweep_us) duration = 0;
  }
  const auto first_part = [&](std::size_t i) {
    const Message& m = *index.messages[i];
    const std::uint64_t skip = std::min<std::uint64_t>(m.pieces.front().size, kScanHeader);
    return FilePart{*log, m.pieces.front().at + skip, m.pieces.front().size - skip};
  };
  MendOptions mend;
  mend.same_points = [&](std::size_t a, std::size_t b) {
    return index.messages[a]->total == index.messages[b]->total && same_content(first_part(a), first_part(b));
  };
  MendedStamps clock = mend_stamps(starts, path, mend);
  drive.warnings.insert(drive.warnings.end(), clock.warnings.begin(), clock.warnings.end());
  std::vector<std::shared_ptr<Message>> kept;
  for (std::size_t i = 0; i < clock.order.size(); ++i) {
    kept.push_back(index.messages[clock.order[i]]);
    drive.scans.push_back(
        {path, clock.stamps_us[i], durations[clock.order[i]], static_cast<std::int64_t>(i)});
  }
  index.messages = std::move(kept);
  const auto messages =
      std::make_shared<const std::vector<std::shared_ptr<Message>>>(std::move(index.messages));
  drive.decode = [log, messages](const DriveScan& entry, Scan& scan) {
    const Message& message = *(*messages)[static_cast<std::size_t>(entry.key)];
    std::string bytes = assemble(*log, message);
    put_big_endian(scan.utime, bytes, 8);  // as mended: what the driver wrote may not be a time at all
    put_big_endian(scan.duration_us, bytes, 16);
    std::optional<Scan> decoded =
        decode_scan(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
    if (!decoded)
      throw Error("a scan's message cannot be understood",
                  log->path() + ", byte " + std::to_string(message.pieces.front().at),
                  "Record the log again.");
    decoded->sequence = scan.sequence;
    decoded->utime = scan.utime;
    decoded->duration_us = scan.duration_us;
    scan = std::move(*decoded);
  };
  return drive;
}

}  // namespace hp2
