// Writers of ROS messages and of MCAP and SQLite bags, byte by byte, by their specifications.
#pragma once
#include <algorithm>
#include <cstdint>
#include <functional>
#include <lz4frame.h>
#include <string>
#include <utility>
#include <vector>
#include <zstd.h>

#include <gtest/gtest.h>
#include <sqlite3.h>

#include "tests/player/test_files.hpp"

namespace hp2::test {

enum class Wire { kRos1, kLittleCdr, kBigCdr };

/// Writes the fields of one message.
class MessageWriter {
 public:
  explicit MessageWriter(Wire wire) : wire_(wire) {}
  std::string bytes() const {
    if (wire_ == Wire::kRos1) return body_;
    return std::string({'\0', wire_ == Wire::kBigCdr ? '\0' : '\1', '\0', '\0'}) + body_;
  }
  template <typename T>
  MessageWriter& add(T value) {
    if (wire_ != Wire::kRos1)
      while (body_.size() % sizeof(T) != 0) body_ += '\0';
    std::string raw;
    put(raw, value);
    if (wire_ == Wire::kBigCdr) std::reverse(raw.begin(), raw.end());
    body_ += raw;
    return *this;
  }
  MessageWriter& text(const std::string& s) {
    const bool cdr = wire_ != Wire::kRos1;
    add(static_cast<std::uint32_t>(s.size() + (cdr ? 1 : 0)));
    body_ += s;
    if (cdr) body_ += '\0';
    return *this;
  }
  MessageWriter& blob(const std::string& s) {
    add(static_cast<std::uint32_t>(s.size()));
    body_ += s;
    return *this;
  }
  MessageWriter& plain(const std::string& s) {
    body_ += s;
    return *this;
  }
  MessageWriter& header(std::int64_t stamp_us, const std::string& frame) {
    if (wire_ == Wire::kRos1) add<std::uint32_t>(7);
    add(static_cast<std::uint32_t>(stamp_us / 1'000'000));
    add(static_cast<std::uint32_t>(stamp_us % 1'000'000 * 1000));
    return text(frame);
  }

 private:
  Wire wire_;
  std::string body_;
};

/// Times of a cloud's points: their field, its PointField type, and what point i of n has.
struct PointTimes {
  std::string field;
  std::uint8_t type = 8;
  std::function<double(std::size_t, std::size_t)> of;
};

inline void put_number(std::string& bytes, std::uint8_t type, double value) {
  if (type == 6) return put(bytes, static_cast<std::uint32_t>(value));
  if (type == 7) return put(bytes, static_cast<float>(value));
  put(bytes, value);
}

/// A sensor_msgs/PointCloud2 of one row.
inline std::string cloud_message(const Scan& scan, std::int64_t stamp_us, const PointTimes& times,
                                 Wire wire = Wire::kLittleCdr, const std::string& frame = "lidar") {
  MessageWriter w(wire);
  const auto n = static_cast<std::uint32_t>(scan.size());
  w.header(stamp_us, frame).add<std::uint32_t>(1).add(n);
  const auto field = [&](const std::string& name, std::uint32_t offset, std::uint8_t type) {
    w.text(name).add(offset).add(type).add<std::uint32_t>(1);
  };
  w.add<std::uint32_t>(times.field.empty() ? 4 : 5);
  field("x", 0, 7), field("y", 4, 7), field("z", 8, 7), field("intensity", 12, 7);
  if (!times.field.empty()) field(times.field, 16, times.type);
  std::string data;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    put(data, scan.x[i]), put(data, scan.y[i]), put(data, scan.z[i]), put(data, scan.intensity[i]);
    if (!times.field.empty()) put_number(data, times.type, times.of(i, n));
  }
  const auto step = static_cast<std::uint32_t>(scan.size() ? data.size() / scan.size() : 16);
  w.add<std::uint8_t>(0).add(step).add(n * step).blob(data).add<std::uint8_t>(1);
  return w.bytes();
}

/// A message in a bag.
struct Recorded {
  std::int64_t utime = 0;
  std::string topic, type, bytes;
};

struct McapOptions {
  bool chunks = true, message_index = true, summary = true, ends = true;
  std::string compression;  ///< "", "zstd", "lz4"
  std::size_t per_chunk = 2;
  bool new_channel_each_time = false;
};

inline std::string packed(const std::string& data, const std::string& compression) {
  std::string out;
  if (compression == "zstd") {
    out.resize(ZSTD_compressBound(data.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), data.data(), data.size(), 1));
  } else if (compression == "lz4") {
    out.resize(LZ4F_compressFrameBound(data.size(), nullptr));
    out.resize(LZ4F_compressFrame(out.data(), out.size(), data.data(), data.size(), nullptr));
  }
  return compression.empty() ? data : out;
}

/// An MCAP file of the messages, in their order.
inline std::string mcap(const std::vector<Recorded>& messages, const McapOptions& o = {}) {
  const std::string magic("\x89MCAP0\r\n", 8);
  const auto text = [](const std::string& s) {
    std::string b;
    put(b, static_cast<std::uint32_t>(s.size()));
    return b + s;
  };
  const auto record = [](char code, const std::string& content) {
    std::string b(1, code);
    put(b, static_cast<std::uint64_t>(content.size()));
    return b + content;
  };
  const auto number = [](auto value) {
    std::string b;
    put(b, value);
    return b;
  };
  std::vector<std::pair<std::string, std::string>> channels;
  std::string descriptions, file = magic + record(1, text("ros2") + text("a test")), chunk, indexes;
  std::string chunk_indexes;
  std::vector<std::pair<std::uint16_t, std::string>> entries;
  std::size_t in_chunk = 0;
  const auto flush = [&] {
    if (!o.chunks || chunk.empty()) return;
    const std::string data = packed(chunk, o.compression);
    const std::size_t at = file.size();
    file += record(6, number(std::uint64_t{0}) + number(std::uint64_t{0}) +
                          number(std::uint64_t{chunk.size()}) + number(std::uint32_t{0}) +
                          text(o.compression) + number(std::uint64_t{data.size()}) + data);
    const std::size_t length = file.size() - at;
    if (o.message_index)
      for (const auto& [channel, entry] : entries) file += record(7, number(channel) + text(entry));
    chunk_indexes += record(8, number(std::uint64_t{0}) + number(std::uint64_t{0}) +
                                   number(std::uint64_t{at}) + number(std::uint64_t{length}) + text("") +
                                   number(std::uint64_t{0}) + text(o.compression) +
                                   number(std::uint64_t{data.size()}) + number(std::uint64_t{chunk.size()}));
    chunk.clear(), entries.clear(), in_chunk = 0;
  };
  for (const Recorded& m : messages) {
    std::string& to = o.chunks ? chunk : file;
    std::pair<std::string, std::string> key = {m.topic, m.type};
    auto it = std::find(channels.begin(), channels.end(), key);
    if (it == channels.end() || o.new_channel_each_time) {
      channels.push_back(key);
      it = channels.end() - 1;
      const auto id = static_cast<std::uint16_t>(channels.size());
      const std::string both = record(3, number(id) + text(m.type) + text("ros2msg") + text("x")) +
                               record(4, number(id) + number(id) + text(m.topic) + text("cdr") + text(""));
      to += both, descriptions += both;
    }
    const auto id = static_cast<std::uint16_t>(it - channels.begin() + 1);
    const auto ns = static_cast<std::uint64_t>(m.utime) * 1000;
    entries.emplace_back(id, number(ns) + number(std::uint64_t{chunk.size()}));
    to += record(5, number(id) + number(std::uint32_t{0}) + number(ns) + number(ns) + m.bytes);
    if (++in_chunk >= o.per_chunk) flush();
  }
  flush();
  if (!o.ends) return file;
  file += record(15, number(std::uint32_t{0}));
  const std::size_t summary_at = file.size();
  if (o.summary) file += descriptions + chunk_indexes;
  file += record(2, number(std::uint64_t{o.summary ? summary_at : 0}) + number(std::uint64_t{0}) +
                        number(std::uint32_t{0}));
  return file + magic;
}

/// Writes a ROS 2 bag in SQLite.
inline void write_db3(const std::string& path, const std::vector<Recorded>& messages) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &db), SQLITE_OK);
  sqlite3_exec(
      db,
      "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,"
      "serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT NULL,"
      "data BLOB NOT NULL);CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
      nullptr, nullptr, nullptr);
  std::vector<std::string> topics;
  const auto run = [&](const char* sql, std::int64_t topic, std::int64_t ns, const std::string& a,
                       const std::string& b) {
    sqlite3_stmt* s = nullptr;
    ASSERT_EQ(sqlite3_prepare_v2(db, sql, -1, &s, nullptr), SQLITE_OK);
    sqlite3_bind_int64(s, 1, topic), sqlite3_bind_int64(s, 2, ns);
    sqlite3_bind_blob(s, 3, a.data(), static_cast<int>(a.size()), SQLITE_STATIC);
    sqlite3_bind_text(s, 4, b.data(), static_cast<int>(b.size()), SQLITE_STATIC);
    EXPECT_EQ(sqlite3_step(s), SQLITE_DONE);
    sqlite3_finalize(s);
  };
  for (const Recorded& m : messages) {
    auto it = std::find(topics.begin(), topics.end(), m.topic);
    if (it == topics.end()) {
      topics.push_back(m.topic);
      it = topics.end() - 1;
      run("INSERT INTO topics VALUES (?1 + 0 * ?2, CAST(?3 AS TEXT), ?4, 'cdr', '')", it - topics.begin() + 1,
          0, m.topic, m.type);
    }
    run("INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)", it - topics.begin() + 1,
        m.utime * 1000, m.bytes, "");
  }
  sqlite3_close(db);
}

}  // namespace hp2::test
