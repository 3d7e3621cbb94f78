// Recordings of ROS 1 and ROS 2 that the test writes by their specifications: whole, damaged, with odd times.
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "player/scan_source.hpp"
#include "tests/player/bag_writers.hpp"

namespace hp2 {
namespace {

using namespace test;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::int64_t kEpoch = 1'700'000'000'000'000;
constexpr std::int64_t kStep = 100'000;
const std::string kCloud = "sensor_msgs/msg/PointCloud2";

PointTimes relative_ns() {
  return {"t", 6, [](std::size_t i, std::size_t n) {
            return std::floor(1e8 * static_cast<double>(i) / static_cast<double>(n - 1));
          }};
}

std::vector<Recorded> clouds(std::size_t n, Wire wire = Wire::kLittleCdr,
                             const PointTimes& times = relative_ns()) {
  std::vector<Recorded> messages;
  for (std::size_t k = 0; k < n; ++k) {
    const std::int64_t stamp = kEpoch + static_cast<std::int64_t>(k) * kStep;
    messages.push_back({stamp + 20'000, "/points", kCloud,
                        cloud_message(make_points(50, static_cast<int>(k)), stamp, times, wire)});
    messages.push_back({stamp + 21'000, "/imu", "sensor_msgs/msg/Imu", "imu"});
  }
  return messages;
}

void expect_clouds(const ScanSource& source, std::size_t n) {
  ASSERT_EQ(source.size(), n);
  for (std::size_t k = 0; k < n; ++k) {
    const Scan scan = source.read(k);
    expect_same_points(scan, make_points(50, static_cast<int>(k)));
    EXPECT_EQ(scan.utime, kEpoch + static_cast<std::int64_t>(k) * kStep);
    EXPECT_EQ(scan.duration_us, 100'000);
    ASSERT_EQ(scan.time.size(), 50U);
    EXPECT_NEAR(scan.time[49], 1.0F, 1e-6);
    EXPECT_NEAR(scan.time[24], 24.0F / 49.0F, 1e-5);
  }
}

TEST(Mcap, AllKindsOfFile) {
  const TemporaryFolder folder;
  for (const std::string compression : {"", "zstd", "lz4"})
    for (int kind = 0; kind < 16; ++kind) {
      McapOptions options;
      options.compression = compression;
      options.message_index = (kind & 1) != 0;
      options.summary = (kind & 2) != 0;
      options.chunks = (kind & 4) != 0;
      options.new_channel_each_time = (kind & 8) != 0;
      SCOPED_TRACE(compression + std::to_string(kind));
      folder.write("drive.mcap", mcap(clouds(5), options));
      const auto source = open_source(folder / "drive.mcap");
      EXPECT_EQ(source->info().format, "rosbag2");
      EXPECT_THAT(source->warnings(), IsEmpty());
      expect_clouds(*source, 5);
    }
}

TEST(Mcap, ChunksThatOverlapInTimeAreSortedByTime) {
  const TemporaryFolder folder;
  std::vector<Recorded> messages = clouds(6);
  std::swap(messages[0], messages[6]), std::swap(messages[2], messages[10]);
  folder.write("drive.mcap", mcap(messages, {true, true, true, true, "zstd", 3, false}));
  expect_clouds(*open_source(folder / "drive.mcap"), 6);
}

TEST(Mcap, FileCutOffAnywhereGivesTheScansBefore) {
  const TemporaryFolder folder;
  for (const bool index : {true, false}) {
    const std::string whole = mcap(clouds(4), {true, index, true, true, "", 2, false});
    std::size_t before = 0;
    for (std::size_t size = 100; size < whole.size(); size += 97) {
      folder.write("cut.mcap", whole.substr(0, size));
      std::size_t scans = 0;
      const std::string error = error_of([&] {
        const auto source = open_source(folder / "cut.mcap");
        scans = source->size();
        EXPECT_FALSE(source->warnings().empty());
        for (std::size_t k = 0; k < scans; ++k)
          expect_same_points(source->read(k), make_points(50, static_cast<int>(k)));
      });
      EXPECT_GE(scans, before) << size << error;
      before = scans;
    }
    EXPECT_EQ(before, 4U);
  }
}

TEST(Mcap, ChecksumThatDoesNotFitIsRefused) {
  const TemporaryFolder folder;
  std::string bytes = mcap(clouds(4), {true, true, true, true, "zstd", 2, false});
  const std::size_t name = bytes.find("zstd");
  bytes.replace(name - 8, 4, "\x12\x34\x56\x78");
  folder.write("drive.mcap", bytes);
  EXPECT_THAT(error_of([&] { open_source(folder / "drive.mcap")->read(0); }), HasSubstr("checksum"));
}

TEST(Mcap, OtherEncodingsAreListedAndRefused) {
  const TemporaryFolder folder;
  std::string bytes = mcap(clouds(2));
  for (std::size_t at = bytes.find("\3\0\0\0cdr", 0, 7); at != std::string::npos;
       at = bytes.find("\3\0\0\0cdr", at + 1, 7))
    bytes.replace(at + 4, 3, "xml");
  folder.write("drive.mcap", bytes);
  EXPECT_THAT(error_of([&] { open_source(folder / "drive.mcap"); }), HasSubstr("PointCloud2 (xml)"));
}

TEST(Db3, BothByteOrders) {
  const TemporaryFolder folder;
  write_db3(folder / "little.db3", clouds(5));
  expect_clouds(*open_source(folder / "little.db3"), 5);
  write_db3(folder / "big.db3", clouds(5, Wire::kBigCdr));
  expect_clouds(*open_source(folder / "big.db3"), 5);
}

TEST(Db3, MessagesAndFilesMayBeCompressed) {
  const TemporaryFolder folder;
  for (const std::string compression : {"zstd", "lz4"}) {
    std::vector<Recorded> messages = clouds(3);
    write_db3(folder / "plain.db3", messages);
    for (Recorded& m : messages) m.bytes = packed(m.bytes, compression);
    write_db3(folder / (compression + ".db3"), messages);
    expect_clouds(*open_source(folder / (compression + ".db3")), 3);
    std::string plain = error_of([] {});
    FILE* file = std::fopen((folder / "plain.db3").c_str(), "rb");
    for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) plain += static_cast<char>(c);
    std::fclose(file);
    std::remove((folder / "plain.db3").c_str());
    folder.write("whole.db3." + compression, packed(plain, compression));
    expect_clouds(*open_source(folder / ("whole.db3." + compression)), 3);
  }
}

TEST(Db3, FileCutOffGivesTheScansBefore) {
  const TemporaryFolder folder;
  write_db3(folder / "whole.db3", clouds(40));
  std::string whole;
  FILE* file = std::fopen((folder / "whole.db3").c_str(), "rb");
  for (int c = std::fgetc(file); c != EOF; c = std::fgetc(file)) whole += static_cast<char>(c);
  std::fclose(file);
  folder.write("cut.db3", whole.substr(0, whole.size() / 2));
  const auto source = open_source(folder / "cut.db3");
  EXPECT_THAT(source->warnings().at(0), HasSubstr("ends early"));
  EXPECT_GT(source->size(), 10U);
  expect_clouds(*source, source->size());
  folder.write("none.db3", whole.substr(0, 30));
  EXPECT_THAT(error_of([&] { open_source(folder / "none.db3"); }), HasSubstr("damaged"));
}

TEST(Recording, FolderOfPartsWithAndWithoutMetadata) {
  const TemporaryFolder folder;
  const auto all = clouds(6);
  folder.write("bag/drive_0.mcap", mcap({all.begin(), all.begin() + 4}));
  folder.write("bag/drive_1.mcap", mcap({all.begin() + 4, all.end()}));
  expect_clouds(*open_source(folder / "bag"), 6);
  folder.write("bag/metadata.yaml",
               "rosbag2_bagfile_information:\n  relative_file_paths:\n    - drive_0.mcap\n"
               "    - \"gone.mcap\"\n  message_count: 12\n");
  const auto source = open_source(folder / "bag");
  expect_clouds(*source, 2);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("gone.mcap"));
}

TEST(Recording, SeveralCloudsAreNamedWithRatesAndSizes) {
  const TemporaryFolder folder;
  std::vector<Recorded> messages = clouds(11);
  for (std::size_t k = 0; k < 11; ++k)
    messages.push_back({messages[2 * k].utime + 7, "/rear", kCloud, messages[2 * k].bytes});
  folder.write("drive.mcap", mcap(messages));
  const std::string error = error_of([&] { open_source(folder / "drive.mcap"); });
  EXPECT_THAT(error, HasSubstr("/points (sensor_msgs/PointCloud2, 11 messages, 10.0 Hz, 1.2 kB each)"));
  EXPECT_THAT(error, HasSubstr("--topic"));
  SourceOptions options;
  options.topic = "rear";
  expect_clouds(*open_source(folder / "drive.mcap", options), 11);
}

TEST(Recording, PacketsOfNoKnownSensorAreRefusedByType) {
  const TemporaryFolder folder;
  MessageWriter w(Wire::kLittleCdr);
  w.header(kEpoch, "velodyne").add<std::uint32_t>(1).add<std::uint32_t>(5).add<std::uint32_t>(0);
  w.plain(std::string(1206, 'x'));
  folder.write("drive.mcap", mcap({{kEpoch, "/packets", "velodyne_msgs/msg/VelodyneScan", w.bytes()}}));
  EXPECT_THAT(error_of([&] { open_source(folder / "drive.mcap"); }), HasSubstr("velodyne_msgs/VelodyneScan"));
}

/// A drive whose points have times of one kind; headers as given.
std::unique_ptr<ScanSource> timed(
    const TemporaryFolder& folder, const std::string& field, std::uint8_t type,
    const std::function<double(double)>& of_instant,
    const std::function<double(int)>& header_late_s = [](int) { return 0.0; }) {
  std::vector<Recorded> messages;
  for (int k = 0; k < 8; ++k) {
    const double start = static_cast<double>(kEpoch) * 1e-6 + k * 0.1;
    const PointTimes times{field, type, [&, start](std::size_t i, std::size_t n) {
                             const double t = 0.1 * static_cast<double>(i) / static_cast<double>(n - 1);
                             return field == "timestamp" ? of_instant(start + t) : of_instant(t);
                           }};
    const std::int64_t stamp = std::llround((start + header_late_s(k)) * 1e6);
    messages.push_back(
        {kEpoch + k * kStep + 150'000, "/points", kCloud, cloud_message(make_points(50, k), stamp, times)});
  }
  folder.write("drive.mcap", mcap(messages));
  return open_source(folder / "drive.mcap");
}

TEST(CloudTimes, UnitsOfAllDrivers) {
  const TemporaryFolder folder;
  expect_clouds(*timed(folder, "t", 6, [](double t) { return t * 1e9; }), 8);  // Ouster
  expect_clouds(*timed(folder, "time", 7, [](double t) { return t; }), 8);     // Velodyne
  expect_clouds(*timed(folder, "offset_time", 6, [](double t) { return t * 1e6; }), 8);
  expect_clouds(*timed(folder, "time", 8, [](double t) { return t * 1e3; }), 8);
  for (const double unit : {1.0, 1e9}) {  // Hesai and RoboSense; Livox
    const auto source = timed(folder, "timestamp", 8, [&](double t) { return t * unit; });
    ASSERT_EQ(source->size(), 8U);
    EXPECT_NEAR(static_cast<double>(source->read(3).utime), static_cast<double>(kEpoch + 3 * kStep), 1.0);
    EXPECT_NEAR(source->read(3).time[24], 24.0F / 49.0F, 1e-4);
  }
  const auto before = timed(
      folder, "time", 7, [](double t) { return t - 0.1; }, [](int) { return 0.1; });
  EXPECT_EQ(before->read(2).utime, kEpoch + 2 * kStep);  // older Velodyne drivers: stamped at the end
}

TEST(CloudTimes, InstantsOfPointsAreBelievedBeforeHeaders) {
  const TemporaryFolder folder;
  for (const double late : {0.1, 0.03}) {
    const auto source = timed(
        folder, "timestamp", 8, [](double t) { return t; },
        [&](int k) { return late < 0.05 ? late * (k % 3) / 2 : late; });
    ASSERT_EQ(source->size(), 8U);
    for (std::size_t k = 0; k < 8; ++k)
      EXPECT_NEAR(static_cast<double>(source->read(k).utime),
                  static_cast<double>(kEpoch) + 1e5 * static_cast<double>(k), 1.0);
    EXPECT_THAT(source->warnings().at(0), HasSubstr("the points' times are used"));
  }
}

TEST(CloudTimes, InstantsOfAnotherClockAreShiftedToTheHeaders) {
  const TemporaryFolder folder;
  const auto source = timed(folder, "timestamp", 8, [](double t) { return t - 1.6e9; });
  EXPECT_NEAR(static_cast<double>(source->read(3).utime), static_cast<double>(kEpoch + 3 * kStep), 2.0);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("another clock"));
}

TEST(CloudTimes, ZerosAmongInstantsAreMissingTimes) {
  const TemporaryFolder folder;
  std::size_t calls = 0;
  const auto source = timed(folder, "timestamp", 8, [&](double t) { return ++calls % 10 == 5 ? 0.0 : t; });
  EXPECT_NEAR(static_cast<double>(source->read(3).utime), static_cast<double>(kEpoch + 3 * kStep), 1.0);
  EXPECT_NEAR(source->read(3).time[25], 25.0F / 49.0F, 1e-4);
}

TEST(CloudTimes, TwoLayoutsOnATopicHaveTheirOwnUnits) {
  const TemporaryFolder folder;
  std::vector<Recorded> messages;
  const PointTimes seconds{"time", 7, [](std::size_t i, std::size_t n) {
                             return 0.1 * static_cast<double>(i) / static_cast<double>(n - 1);
                           }};
  for (int k = 0; k < 12; ++k) {
    const std::int64_t stamp = kEpoch + k * kStep / 2;
    messages.push_back({stamp, "/points", kCloud,
                        cloud_message(make_points(50, k), stamp, k % 2 ? seconds : relative_ns())});
  }
  folder.write("drive.mcap", mcap(messages));
  const auto source = open_source(folder / "drive.mcap");
  for (const std::size_t k : {4U, 5U}) {
    const Scan scan = source->read(k);
    EXPECT_EQ(scan.duration_us, 100'000);
    EXPECT_NEAR(scan.time[24], 24.0F / 49.0F, 1e-5);
  }
}

TEST(Livox, CustomMessageOfBothRosVersions) {
  for (const Wire wire : {Wire::kLittleCdr, Wire::kBigCdr}) {
    const TemporaryFolder folder;
    std::vector<Recorded> messages;
    for (int k = 0; k < 4; ++k) {
      const Scan scan = make_points(50, k);
      const std::int64_t start = kEpoch + k * kStep;
      MessageWriter w(wire);
      w.header(start + 5'000 * (k % 2), "livox")
          .add(static_cast<std::uint64_t>(start) * 1000)
          .add<std::uint32_t>(50);
      for (int i = 0; i < 4; ++i) w.add<std::uint8_t>(0);
      w.add<std::uint32_t>(50);
      for (std::size_t i = 0; i < 50; ++i) {
        w.add(static_cast<std::uint32_t>(i * 100'000'000 / 49)).add(scan.x[i]).add(scan.y[i]).add(scan.z[i]);
        w.add(static_cast<std::uint8_t>(i % 7)).add<std::uint8_t>(16).add<std::uint8_t>(2);
      }
      messages.push_back({start + 120'000, "/livox/lidar", "livox_ros_driver2/msg/CustomMsg", w.bytes()});
    }
    folder.write("drive.mcap", mcap(messages));
    const auto source = open_source(folder / "drive.mcap");
    ASSERT_EQ(source->size(), 4U);
    const Scan scan = source->read(1);
    EXPECT_EQ(scan.x, make_points(50, 1).x);
    EXPECT_EQ(scan.intensity[6], 6.0F);
    EXPECT_EQ(scan.utime, kEpoch + kStep);
    EXPECT_NEAR(scan.time[24], 24.0F / 49.0F, 1e-5);
  }
}

Recorded odometry(std::int64_t utime, double x) {
  MessageWriter w(Wire::kLittleCdr);
  w.header(utime, "odom").text("base").add(x).add(2.0).add(0.0).add(0.0).add(0.0).add(0.0).add(1.0);
  return {utime, "/odom", "nav_msgs/msg/Odometry", w.bytes()};
}

TEST(GroundTruthTopic, OdometryIsMovedToTheLidarByFixedTransforms) {
  const TemporaryFolder folder;
  std::vector<Recorded> messages = clouds(4);
  for (int k = 0; k < 12; ++k) messages.push_back(odometry(kEpoch + k * 50'000, 0.5 * k));
  SourceOptions options;
  options.ground_truth_topic = "/odom";
  folder.write("bare.mcap", mcap(messages));
  const auto bare = open_source(folder / "bare.mcap", options);
  ASSERT_EQ(bare->ground_truth().size(), 4U);
  EXPECT_NEAR(bare->ground_truth()[1].pose.translation.x(), 2.0, 1e-9);  // at the sweep's end, 0.2 s
  EXPECT_THAT(bare->warnings().at(0), HasSubstr("/tf_static does not connect"));
  MessageWriter tf(Wire::kLittleCdr);
  tf.add<std::uint32_t>(1).header(kEpoch, "base").text("lidar");
  tf.add(0.0).add(0.0).add(1.5).add(0.0).add(0.0).add(0.0).add(1.0);
  messages.push_back({kEpoch, "/tf_static", "tf2_msgs/msg/TFMessage", tf.bytes()});
  folder.write("tf.mcap", mcap(messages));
  const auto moved = open_source(folder / "tf.mcap", options);
  EXPECT_THAT(moved->warnings(), IsEmpty());
  EXPECT_NEAR(moved->ground_truth()[1].pose.translation.z(), 1.5, 1e-9);
  options.ground_truth_topic = "/nothing";
  EXPECT_THAT(error_of([&] { open_source(folder / "tf.mcap", options); }),
              HasSubstr("/odom (nav_msgs/Odometry)"));
}

TEST(GroundTruthTopic, SatelliteFixesBecomeMetres) {
  const TemporaryFolder folder;
  std::vector<Recorded> messages = clouds(4);
  for (int k = 0; k < 6; ++k) {
    MessageWriter w(Wire::kLittleCdr);
    w.header(kEpoch + k * kStep, "gps").add<std::int8_t>(k == 0 ? -1 : 0).add<std::uint16_t>(1);
    w.add(48.0).add(11.0 + 1e-5 * (k - 1)).add(500.0);
    messages.push_back({kEpoch + k * kStep, "/fix", "sensor_msgs/msg/NavSatFix", w.bytes()});
  }
  folder.write("drive.mcap", mcap(messages));
  SourceOptions options;
  options.ground_truth_topic = "/fix";
  const auto source = open_source(folder / "drive.mcap", options);
  ASSERT_EQ(source->ground_truth().size(), 4U);
  EXPECT_NEAR(source->ground_truth()[3].pose.translation.x(), 3 * 0.7459,
              2e-3);  // 1e-5 degrees at 48 degrees north
  EXPECT_NEAR(source->ground_truth()[3].pose.translation.y(), 0.0, 1e-3);
}

}  // namespace
}  // namespace hp2
