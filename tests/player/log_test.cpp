// LCM logs and ROS bags that the test writes byte by byte, whole and damaged.
#include <bzlib.h>
#include <cmath>
#include <hp2/chunk_t.hpp>
#include <lz4frame.h>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/transport/convert.hpp"
#include "common/transport/crc32.hpp"
#include "player/scan_source.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::error_of;
using test::make_points;
using test::put;
using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;

template <typename T>
void put_big(std::string& bytes, T value) {
  std::string raw;
  put(raw, value);
  bytes.append(raw.rbegin(), raw.rend());
}

/// One event as lcm-logger writes it.
std::string event(const std::string& channel, const ByteVector& data) {
  std::string b;
  put_big<std::uint32_t>(b, 0xeda1da01U);
  put_big<std::int64_t>(b, 0), put_big<std::int64_t>(b, 12345);
  put_big<std::int32_t>(b, static_cast<std::int32_t>(channel.size()));
  put_big<std::int32_t>(b, static_cast<std::int32_t>(data.size()));
  return b + channel + std::string(data.begin(), data.end());
}

Scan timed_scan(int k, std::size_t n = 10) {
  Scan scan = make_points(n, k);
  scan.utime = 1'000'000 + k * 100'000;
  scan.duration_us = 90'000;
  scan.sequence = k + 40;
  scan.sensor = "driver";
  for (std::size_t i = 0; i < n; ++i) scan.time.push_back(static_cast<float>(i) / static_cast<float>(n));
  return scan;
}

/// The pieces of a scan, `size` bytes each.
std::vector<ByteVector> pieces_of(const Scan& scan, std::size_t size) {
  const ByteVector whole = encode_scan(scan);
  std::vector<ByteVector> pieces;
  const std::size_t count = (whole.size() + size - 1) / size;
  for (std::size_t i = 0; i < count; ++i) {
    chunk_t c{};
    c.session_id = 5, c.sender_id = 6, c.message_id = scan.sequence;
    c.index = static_cast<std::int32_t>(i), c.count = static_cast<std::int32_t>(count);
    c.total_size = static_cast<std::int32_t>(whole.size()), c.offset = static_cast<std::int32_t>(i * size);
    c.crc32 = static_cast<std::int32_t>(crc32(whole.data(), whole.size()));
    c.data.assign(whole.begin() + c.offset,
                  whole.begin() + static_cast<std::ptrdiff_t>(std::min(whole.size(), (i + 1) * size)));
    c.size = static_cast<std::int32_t>(c.data.size());
    pieces.push_back(encode_message(c));
  }
  return pieces;
}

void expect_scan(const Scan& scan, const Scan& expected, std::int64_t sequence) {
  test::expect_same_points(scan, expected);
  EXPECT_EQ(scan.time, expected.time);
  EXPECT_EQ(scan.utime, expected.utime);
  EXPECT_EQ(scan.duration_us, expected.duration_us);
  EXPECT_EQ(scan.sequence, sequence);
}

TEST(LcmLog, WholeScans) {
  const TemporaryFolder folder;
  std::string log;
  for (int k = 0; k < 3; ++k)
    log +=
        event("HP2_SCAN", encode_scan(timed_scan(k, k == 1 ? 250'000 : 10))) + event("HP2_STATUS", {1, 2, 3});
  folder.write("drive.lcm", log);
  const auto source = open_source(folder / "drive.lcm");
  EXPECT_EQ(source->info().format, "lcm-log");
  EXPECT_TRUE(source->warnings().empty());
  ASSERT_EQ(source->size(), 3U);
  for (int k = 0; k < 3; ++k)
    expect_scan(source->read(static_cast<std::size_t>(k)), timed_scan(k, k == 1 ? 250'000 : 10), k);
}

TEST(LcmLog, PiecesInAnyOrderTwiceAndMissing) {
  const TemporaryFolder folder;
  const auto a = pieces_of(timed_scan(0, 100), 700);
  const auto b = pieces_of(timed_scan(1, 100), 700);
  const auto c = pieces_of(timed_scan(2, 100), 700);
  ASSERT_EQ(a.size(), 3U);
  std::string log;
  for (const auto* piece : {&a[0], &a[2], &b[1], &a[1], &b[0], &a[1], &c[0], &b[2], &c[2]})
    log += event("HP2_CHUNK_SCAN", *piece);
  folder.write("drive.lcm", log);
  const auto source = open_source(folder / "drive.lcm");
  ASSERT_EQ(source->size(), 2U);
  expect_scan(source->read(0), timed_scan(0, 100), 0);
  expect_scan(source->read(1), timed_scan(1, 100), 1);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("1 scans"));
}

TEST(LcmLog, SeveralChannels) {
  const TemporaryFolder folder;
  folder.write("l.lcm",
               event("FRONT", encode_scan(timed_scan(0))) + event("REAR", encode_scan(timed_scan(1))));
  EXPECT_THAT(error_of([&] { open_source(folder / "l.lcm"); }), HasSubstr("FRONT, REAR"));
  SourceOptions options;
  options.topic = "REAR";
  expect_scan(open_source(folder / "l.lcm", options)->read(0), timed_scan(1), 0);
  options.topic = "TOP";
  EXPECT_THAT(error_of([&] { open_source(folder / "l.lcm", options); }),
              HasSubstr("no scans on this channel: TOP"));
}

TEST(LcmLog, Damage) {
  const TemporaryFolder folder;
  const std::string one = event("HP2_SCAN", encode_scan(timed_scan(0)));
  const std::string two = event("HP2_SCAN", encode_scan(timed_scan(1)));
  folder.write("cut.lcm", one + two.substr(0, 80));
  const auto cut = open_source(folder / "cut.lcm");
  EXPECT_EQ(cut->size(), 1U);
  EXPECT_THAT(cut->warnings().at(0), HasSubstr("ends early"));
  folder.write("none.lcm", event("X", {1, 2, 3}));
  EXPECT_THAT(error_of([&] { open_source(folder / "none.lcm"); }), HasSubstr("holds no scan"));
  std::string wrong = one + two;
  wrong[one.size() + 28 + 8 + 8 + 8 + 8 + 4 + 7 + 8 + 8] =
      0x7f;  // number of points of the second: 2^31 and some
  folder.write("wrong.lcm", wrong);
  EXPECT_THAT(error_of([&] { open_source(folder / "wrong.lcm")->read(1); }),
              HasSubstr("cannot be understood"));
  auto pieces = pieces_of(timed_scan(0, 100), 700);
  pieces[1].back() ^= 1;
  std::string log;
  for (const auto& piece : pieces) log += event("HP2_CHUNK_SCAN", piece);
  folder.write("crc.lcm", log);
  EXPECT_THAT(error_of([&] { open_source(folder / "crc.lcm")->read(0); }), HasSubstr("damaged"));
  std::mt19937 random(1);
  for (int k = 0; k < 300; ++k) {
    std::string bad = log + one;
    for (int i = 0; i < 3; ++i) bad[random() % 400] = static_cast<char>(random());
    folder.write("bad.lcm", bad);
    error_of([&] {
      const auto source = open_source(folder / "bad.lcm");
      for (std::size_t i = 0; i < source->size(); ++i) error_of([&] { source->read(i); });
    });
  }
}

TEST(LcmLog, AbsurdPieceCountsTakeNoMemory) {
  const TemporaryFolder folder;
  std::string log = event("HP2_SCAN", encode_scan(timed_scan(0)));
  for (int k = 0; k < 2000; ++k) {  // with room for all pieces that are promised: 50 GB
    chunk_t c{};
    c.message_id = k, c.count = 1 << 20, c.index = c.count - 1, c.total_size = 1000;
    log += event("HP2_SCAN", encode_message(c));
  }
  folder.write("drive.lcm", log);
  const auto source = open_source(folder / "drive.lcm");
  EXPECT_EQ(source->size(), 1U);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("2000 scans"));
}

// ---------------------------------------------------------------- ROS bags

std::string field(const std::string& name, const std::string& value) {
  std::string b;
  put(b, static_cast<std::uint32_t>(name.size() + 1 + value.size()));
  return b + name + "=" + value;
}
template <typename T>
std::string raw(T value) {
  std::string b;
  put(b, value);
  return b;
}
std::string text(const std::string& s) { return raw(static_cast<std::uint32_t>(s.size())) + s; }
std::string record(const std::string& header, const std::string& data) { return text(header) + text(data); }
std::string ros_time(std::int64_t us) {
  return raw(static_cast<std::uint32_t>(us / 1'000'000)) +
         raw(static_cast<std::uint32_t>(us % 1'000'000 * 1000));
}

/// A cloud of two rows with gaps after each row and point; time in seconds as a double.
std::string cloud(const Scan& s, std::int64_t stamp, std::uint32_t claimed_width) {
  const std::size_t width = s.size() / 2;
  std::string b = raw<std::uint32_t>(9) + ros_time(stamp) + text("lidar");
  b += raw<std::uint32_t>(2) + raw(claimed_width);
  const auto point_field = [](const std::string& name, std::uint32_t offset, std::uint8_t type) {
    return text(name) + raw(offset) + raw(type) + raw<std::uint32_t>(1);
  };
  b += raw<std::uint32_t>(5) + point_field("x", 0, 7) + point_field("y", 4, 7) + point_field("z", 8, 7) +
       point_field("intensity", 16, 7) + point_field("time", 20, 8);
  b += raw<std::uint8_t>(0) + raw<std::uint32_t>(32) + raw(static_cast<std::uint32_t>(32 * width + 8));
  std::string data;
  for (std::size_t i = 0; i < s.size(); ++i) {
    put(data, s.x[i]), put(data, s.y[i]), put(data, s.z[i]), data += "gap.";
    put(data, s.intensity[i]), put(data, 0.1 * static_cast<double>(i) / static_cast<double>(s.size() - 1)),
        data += "gap.";
    if (i + 1 == width || i + 1 == s.size()) data += "8 bytes.";
  }
  return b + text(data) + raw<std::uint8_t>(1);
}

std::string pack(const std::string& data, const std::string& compression) {
  if (compression == "bz2") {
    std::string out(data.size() * 2 + 1000, '\0');
    auto n = static_cast<unsigned>(out.size());
    EXPECT_EQ(BZ2_bzBuffToBuffCompress(out.data(), &n, const_cast<char*>(data.data()),
                                       static_cast<unsigned>(data.size()), 9, 0, 0),
              BZ_OK);
    return out.substr(0, n);
  }
  if (compression == "lz4") {
    std::string out(LZ4F_compressFrameBound(data.size(), nullptr), '\0');
    out.resize(LZ4F_compressFrame(out.data(), out.size(), data.data(), data.size(), nullptr));
    return out;
  }
  return data;
}

/// A bag: one chunk a cloud, then the connections. Connection 3 is no cloud.
std::string bag(const std::vector<std::pair<std::string, std::int64_t>>& clouds,
                const std::string& compression = "none", const std::string& second_topic = "") {
  std::string b = "#ROSBAG V2.0\n" + record(field("op", "\3") + field("index_pos", raw<std::uint64_t>(0)),
                                            std::string(100, ' '));
  const auto connection = [](std::uint32_t id, const std::string& topic, const std::string& type) {
    return record(field("op", "\7") + field("conn", raw(id)) + field("topic", topic),
                  field("topic", topic) + field("type", type) + field("md5sum", "*"));
  };
  std::uint32_t id = 0;
  for (const auto& [message, time] : clouds) {
    const std::string imu = record(
        field("op", "\2") + field("conn", raw<std::uint32_t>(3)) + field("time", ros_time(time)), "imu");
    const std::string chunk =
        imu + record(field("op", "\2") + field("conn", raw(id)) + field("time", ros_time(time)), message);
    b += record(field("op", "\5") + field("compression", compression) +
                    field("size", raw(static_cast<std::uint32_t>(chunk.size()))),
                pack(chunk, compression));
    b += record(field("op", "\4") + field("ver", raw<std::uint32_t>(1)) +
                    field("conn", raw<std::uint32_t>(3)) + field("count", raw<std::uint32_t>(1)),
                ros_time(time) + raw<std::uint32_t>(0));
    b += record(field("op", "\4") + field("ver", raw<std::uint32_t>(1)) + field("conn", raw(id)) +
                    field("count", raw<std::uint32_t>(1)),
                ros_time(time) + raw(static_cast<std::uint32_t>(imu.size())));
    if (!second_topic.empty()) id = 1 - id;
  }
  const std::size_t header_at = b.find("index_pos=") + 10;
  b.replace(header_at, 8, raw<std::uint64_t>(b.size()));
  b += connection(0, "/points", "sensor_msgs/PointCloud2") + connection(3, "/imu", "sensor_msgs/Imu");
  if (!second_topic.empty()) b += connection(1, second_topic, "sensor_msgs/PointCloud2");
  return b;
}

constexpr std::int64_t kEpoch = 1'600'000'000'000'000;

std::vector<std::pair<std::string, std::int64_t>> three_clouds() {
  std::vector<std::pair<std::string, std::int64_t>> clouds;
  for (int k = 0; k < 3; ++k)  // recorded 0.12 s after the stamp
    clouds.emplace_back(cloud(make_points(20, k), kEpoch + k * 100'000, 10), kEpoch + k * 100'000 + 120'000);
  return clouds;
}

TEST(Rosbag, PointsAndTimes) {
  const TemporaryFolder folder;
  folder.write("drive.bag", bag(three_clouds()));
  const auto source = open_source(folder / "drive.bag");
  EXPECT_EQ(source->info().format, "rosbag");
  EXPECT_TRUE(source->warnings().empty());
  ASSERT_EQ(source->size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    const Scan scan = source->read(k);
    test::expect_same_points(scan, make_points(20, static_cast<int>(k)));
    EXPECT_EQ(scan.utime, kEpoch + static_cast<std::int64_t>(k) * 100'000);
    EXPECT_EQ(scan.duration_us, 100'000);
    EXPECT_NEAR(scan.time[19], 1.0F, 1e-6);
    EXPECT_NEAR(scan.time[10], 10.0F / 19.0F, 1e-6);
  }
}

TEST(Rosbag, Topics) {
  const TemporaryFolder folder;
  folder.write("drive.bag", bag(three_clouds(), "none", "/rear"));
  EXPECT_THAT(error_of([&] { open_source(folder / "drive.bag"); }),
              AllOf(HasSubstr("/points (sensor_msgs/PointCloud2, 2 messages"), HasSubstr("; /rear (")));
  SourceOptions options;
  options.topic = "/rear";
  const auto source = open_source(folder / "drive.bag", options);
  ASSERT_EQ(source->size(), 1U);
  test::expect_same_points(source->read(0), make_points(20, 1));
  options.topic = "/imu";
  EXPECT_THAT(error_of([&] { open_source(folder / "drive.bag", options); }),
              HasSubstr("the topic /imu holds no LiDAR scans"));
}

TEST(Rosbag, CompressedChunks) {
  for (const std::string compression : {"bz2", "lz4"}) {
    const TemporaryFolder folder;
    folder.write("drive.bag", bag(three_clouds(), compression));
    const auto source = open_source(folder / "drive.bag");
    ASSERT_EQ(source->size(), 3U);
    test::expect_same_points(source->read(2), make_points(20, 2));
    EXPECT_EQ(source->read(2).utime, kEpoch + 200'000);
    std::string bad = bag(three_clouds(), compression);
    for (std::size_t i = 300; i < 360; ++i) bad[i] = '\x55';
    folder.write("bad.bag", bad);
    error_of([&] { open_source(folder / "bad.bag")->read(0); });
  }
}

TEST(Rosbag, Damage) {
  const TemporaryFolder folder;
  auto clouds = three_clouds();
  clouds[1].first = cloud(make_points(20, 1), kEpoch + 100'000, 1'000'000'000);
  folder.write("lie.bag", bag(clouds));
  const auto lie = open_source(folder / "lie.bag");
  EXPECT_THAT(error_of([&] { lie->read(1); }), HasSubstr("promises 2000000000 points"));
  test::expect_same_points(lie->read(2), make_points(20, 2));

  clouds = three_clouds();
  clouds[2].first.resize(200);
  folder.write("short.bag", bag(clouds));
  EXPECT_THAT(error_of([&] { open_source(folder / "short.bag")->read(2); }), HasSubstr("promises"));

  const std::string good = bag(three_clouds());
  folder.write("cut.bag", good.substr(0, good.size() / 2));
  EXPECT_THAT(error_of([&] { open_source(folder / "cut.bag"); }), HasSubstr("has no message at all"));
  folder.write("empty.bag", "#ROSBAG V2.0\n");
  EXPECT_NE(error_of([&] { open_source(folder / "empty.bag"); }), "");
  std::mt19937 random(2);
  for (int k = 0; k < 300; ++k) {
    std::string bad = good;
    for (int i = 0; i < 4; ++i) bad[13 + random() % (bad.size() - 13)] = static_cast<char>(random());
    folder.write("bad.bag", bad);
    error_of([&] {
      const auto source = open_source(folder / "bad.bag");
      for (std::size_t i = 0; i < source->size(); ++i) error_of([&] { source->read(i); });
    });
  }
}

TEST(Rosbag, IndexThatRepeatsAMessageHasItOnce) {
  const TemporaryFolder folder;
  std::string bytes = bag(three_clouds());
  const std::size_t index = bytes.find(field("op", "\4"), bytes.find(field("op", "\4")) + 1);  // the cloud's
  const std::size_t size_at = bytes.find(raw<std::uint32_t>(12), index);
  const std::string entry = bytes.substr(size_at + 4, 12);
  std::string many;
  for (int k = 0; k < 200'000; ++k) many += entry;
  bytes.replace(size_at, 16, text(many));
  folder.write("drive.bag", bytes);
  const auto source = open_source(folder / "drive.bag");
  ASSERT_EQ(source->size(), 3U);
  test::expect_same_points(source->read(1), make_points(20, 1));
  EXPECT_THAT(source->warnings().at(0), HasSubstr("not closed")) << "the bag's header names another place";
}

TEST(Rosbag, ManyAndFewPoints) {
  const TemporaryFolder folder;
  folder.write("drive.bag", bag({{cloud(make_points(250'000), kEpoch, 125'000), kEpoch + 1},
                                 {cloud(make_points(10), kEpoch + 100'000, 5), kEpoch + 100'001}}));
  const auto source = open_source(folder / "drive.bag");
  test::expect_same_points(source->read(0), make_points(250'000));
  test::expect_same_points(source->read(1), make_points(10));
}

}  // namespace
}  // namespace hp2
