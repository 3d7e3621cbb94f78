// KITTI raw, MulRan, HeLiPR and Apollo: small drives written in exactly their layouts, whole and damaged.
#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "player/readers/point_file.hpp"
#include "player/scan_source.hpp"
#include "player/sweep/vertical_angles.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::bin_of;
using test::error_of;
using test::make_points;
using test::put;
using test::TemporaryFolder;
using ::testing::HasSubstr;

SourceOptions dataset(const std::string& name) {
  SourceOptions options;
  options.dataset = name;
  return options;
}

// ---------------------------------------------------------------- KITTI raw

/// Four scans at 10 Hz, number 2 missing; the car drives east at 10 m/s with the LiDAR 0.8 m before the IMU.
void write_kitti_raw(const TemporaryFolder& folder) {
  const std::string drive = "2011_09_26/2011_09_26_drive_0009_sync/";
  const std::string points = drive + "velodyne_points/";
  std::string start, middle, end, oxts;
  for (int i = 0; i < 4; ++i) {
    const auto stamp = [&](int hundredths) {
      const std::string digits = std::to_string(1000 + hundredths);
      return "2011-09-26 13:02:2" + std::to_string(5 + hundredths / 100) + "." +
             digits.substr(digits.size() - 2) + "5000000\n";
    };
    start += stamp(10 * i), middle += stamp(10 * i + 5), end += stamp(10 * i + 10), oxts += stamp(10 * i + 5);
    const std::string name = "000000000" + std::to_string(i);
    if (i != 2) folder.write(points + "data/" + name + ".bin", bin_of(make_points(20, i)));
    const double metres_per_degree = M_PI * 6378137.0 / 180.0 * std::cos(49.0 * M_PI / 180.0);
    char line[200];
    std::snprintf(line, sizeof(line), "49.0 %.12f 110.0 0 0 0 0 0 0\n",
                  8.0 + static_cast<double>(i) / metres_per_degree);
    folder.write(drive + "oxts/data/" + name + ".txt", line);
  }
  folder.write(points + "timestamps_start.txt", start);
  folder.write(points + "timestamps.txt", middle);
  folder.write(points + "timestamps_end.txt", end);
  folder.write(drive + "oxts/timestamps.txt", oxts);
  folder.write("2011_09_26/calib_imu_to_velo.txt",
               "calib_time: 25-May-2012\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n");
}

TEST(KittiRaw, PointsTimesAndPoses) {
  const TemporaryFolder folder;
  write_kitti_raw(folder);
  SourceOptions options;
  options.kitti_correction = 0;
  const std::string drive = folder / "2011_09_26/2011_09_26_drive_0009_sync";
  const auto source = open_source(drive, options);
  EXPECT_EQ(source->info().format, "kitti-raw");
  EXPECT_TRUE(source->warnings().empty());
  // As the scans of the odometry benchmark they are corrected unless that is turned off.
  const auto corrected = open_source(drive);
  EXPECT_THAT(corrected->warnings().at(0), HasSubstr("0.205 degrees"));
  Scan expected = make_points(20, 3);
  correct_kitti_vertical_angle(expected);
  test::expect_same_points(corrected->read(2), expected);
  ASSERT_EQ(source->size(), 3U);
  const Scan last = source->read(2);  // frame 3
  test::expect_same_points(last, make_points(20, 3));
  EXPECT_EQ(last.utime, 1317042145'000'000 + 305'000);  // 2011-09-26 13:02:25 UTC and 0.305 s
  EXPECT_EQ(last.duration_us, 100'000);
  for (std::size_t i = 0; i < last.size(); ++i)
    EXPECT_NEAR(last.time[i], 0.5 * (1.0 - std::atan2(last.y[i], last.x[i]) / M_PI), 1e-6);
  ASSERT_EQ(source->ground_truth().size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {  // 1 m a frame; at the end of a sweep half a frame beyond its middle
    EXPECT_EQ(source->ground_truth()[i].utime, source->read(i).utime_end());
    const Eigen::Vector3d t = source->ground_truth()[i].pose.translation;
    EXPECT_NEAR(t.x(), (i == 2 ? 3.0 : static_cast<double>(i)) + 0.5, 1e-4);
    EXPECT_NEAR(t.y(), 0.0, 1e-4);
  }
  // The folder of the points itself is the drive, too.
  EXPECT_EQ(open_source(folder / "2011_09_26/2011_09_26_drive_0009_sync/velodyne_points")->size(), 3U);
}

TEST(KittiRaw, TextScansAndMissingFiles) {
  const TemporaryFolder folder;
  write_kitti_raw(folder);
  const std::string drive = folder / "2011_09_26/2011_09_26_drive_0009_sync";
  std::filesystem::remove_all(drive + "/velodyne_points/data");
  const std::string name = "2011_09_26/2011_09_26_drive_0009_sync/velodyne_points/data/000000000";
  folder.write(name + "0.txt", "1.5 2 -0.25 0.5\n3 4 5 0.125\n");
  folder.write(name + "1.txt", "1 2 3\n4 5 6 7\n");
  folder.write(name + "2.txt", "");
  const auto source = open_source(drive);
  const Scan scan = source->read(0);
  ASSERT_EQ(scan.size(), 2U);
  EXPECT_NEAR(scan.x[0], 1.5F, 0.01F);  // the vertical angle is corrected
  EXPECT_EQ(scan.intensity[1], 0.125F);
  EXPECT_THAT(error_of([&] { source->read(1); }), HasSubstr("0000000001.txt, line 1"));
  EXPECT_EQ(source->read(2).size(), 0U);

  std::filesystem::remove(folder / "2011_09_26/calib_imu_to_velo.txt");
  EXPECT_TRUE(open_source(drive)->ground_truth().empty());
  EXPECT_THAT(open_source(drive)->warnings().at(0), HasSubstr("calib_imu_to_velo.txt"));
  std::filesystem::remove_all(drive + "/oxts");
  EXPECT_THAT(open_source(drive)->warnings().at(0), HasSubstr("oxts"));
  std::filesystem::remove(drive + "/velodyne_points/timestamps_start.txt");
  EXPECT_EQ(open_source(drive)->read(0).utime, 1317042145'000'000 + 5'000);  // from the middle
  std::filesystem::remove(drive + "/velodyne_points/timestamps.txt");
  EXPECT_THAT(open_source(drive)->warnings().at(0), HasSubstr("10 scans a second"));
  EXPECT_THAT(error_of([&] { open_source(folder / "2011_09_26", dataset("kitti-raw")); }),
              HasSubstr("no scan"));
}

TEST(KittiRaw, ScansOfAnySize) {
  const TemporaryFolder folder;
  write_kitti_raw(folder);
  const std::string drive = "2011_09_26/2011_09_26_drive_0009_sync/";
  folder.write(drive + "velodyne_points/data/0000000000.bin", bin_of(make_points(250'000)));
  folder.write(drive + "velodyne_points/data/0000000001.bin", bin_of(make_points(10)));
  SourceOptions options;
  options.kitti_correction = 0;
  const auto source = open_source(folder / drive, options);
  const Scan large = source->read(0);
  test::expect_same_points(large, make_points(250'000));
  EXPECT_EQ(large.time.size(), 250'000U);
  test::expect_same_points(source->read(1), make_points(10));
  folder.write(drive + "velodyne_points/data/0000000003.bin", bin_of(make_points(10)) + "xyz");
  EXPECT_THAT(error_of([&] { source->read(2); }), HasSubstr("0000000003.bin"));
}

// ---------------------------------------------------------------- MulRan

TEST(MulRan, PointsTimesAndPoses) {
  const TemporaryFolder folder;
  const Scan whole = make_points(65536);
  folder.write("KAIST01/Ouster/1561000444390857630.bin", bin_of(whole));
  folder.write("KAIST01/Ouster/1561000444490857630.bin", bin_of(make_points(100)));
  std::string csv;
  for (int k = 0; k < 30; ++k)  // 100 poses a second, 0.1 m apart
    csv += std::to_string(1561000444390857630 + k * 10'000'000LL) + ",1,0,0," +
           std::to_string(350000.0 + 0.1 * k) + ",0,1,0,4026000.5,0,0,1,19\n";
  folder.write("KAIST01/global_pose.csv", csv);
  const auto source = open_source(folder / "KAIST01");
  EXPECT_EQ(source->info().format, "mulran");
  ASSERT_EQ(source->warnings().size(), 1U);
  EXPECT_THAT(source->warnings()[0], HasSubstr("1 of 2 scans"));
  const Scan scan = source->read(0);
  test::expect_same_points(scan, whole);
  EXPECT_EQ(scan.utime, 1561000444390857);
  EXPECT_EQ(scan.duration_us, 100'000);
  EXPECT_EQ(scan.time[63], 0.0F);
  EXPECT_EQ(scan.time[64], 1.0F / 1024.0F);
  EXPECT_EQ(scan.time[65535], 1023.0F / 1024.0F);
  const Scan damaged = source->read(1);
  EXPECT_EQ(damaged.size(), 100U);
  EXPECT_TRUE(damaged.time.empty());
  EXPECT_EQ(damaged.duration_us, 0);
  ASSERT_EQ(source->ground_truth().size(), 2U);
  const Pose pose =
      source->ground_truth()[0].pose;  // the tenth one, 1 m on, and the sensor's place on the car
  EXPECT_EQ(source->ground_truth()[0].utime, scan.utime_end());
  EXPECT_NEAR(pose.translation.x(), 350001.0 + 1.7042, 1e-5);
  EXPECT_NEAR(pose.translation.y(), 4026000.5 - 0.021, 1e-5);
  EXPECT_NEAR(pose.translation.z(), 19 + 1.8047, 1e-6);
  EXPECT_NEAR(rotation_angle(pose.rotation), 179.6654 * M_PI / 180, 1e-5);
  EXPECT_EQ(open_source(folder / "KAIST01/Ouster")->size(), 2U);
}

TEST(MulRan, Damage) {
  const TemporaryFolder folder;
  folder.write("Ouster/1561000444390857630.bin", bin_of(make_points(10)) + "x");
  folder.write("Ouster/not_a_time.bin", "");
  const auto source = open_source(folder.path());
  EXPECT_THAT(error_of([&] { source->read(0); }), HasSubstr("truncated"));
  EXPECT_EQ(source->read(1).size(), 0U);
  const auto warnings = source->warnings();
  EXPECT_THAT(warnings, ::testing::Contains(HasSubstr("not_a_time.bin")));
  EXPECT_THAT(warnings, ::testing::Contains(HasSubstr("global_pose.csv")));
  EXPECT_TRUE(source->ground_truth().empty());
  folder.write("global_pose.csv", "nan,1,0,0,0\nwhat\n1561000444390857630,1,2,3\n");
  EXPECT_TRUE(open_source(folder.path())->ground_truth().empty());
}

TEST(MulRan, ScansOfAnySize) {  // other sensors' files: no times, all points
  const TemporaryFolder folder;
  folder.write("Ouster/1561000444390857630.bin", bin_of(make_points(250'000)));
  folder.write("Ouster/1561000444490857630.bin", bin_of(make_points(10)));
  const auto source = open_source(folder.path());
  test::expect_same_points(source->read(0), make_points(250'000));
  test::expect_same_points(source->read(1), make_points(10));
  EXPECT_THAT(source->warnings(), ::testing::Contains(HasSubstr("2 of 2 scans")));
}

// ---------------------------------------------------------------- HeLiPR

std::string helipr_bytes(const std::string& sensor, const Scan& s, const std::vector<double>& time_s,
                         bool old_aeva) {
  std::string b;
  for (std::size_t i = 0; i < s.size(); ++i) {
    put(b, s.x[i]), put(b, s.y[i]), put(b, s.z[i]);
    const auto ns = static_cast<std::int32_t>(std::lround(time_s[i] * 1e9));
    if (sensor == "Ouster") {
      put(b, s.intensity[i]), put(b, static_cast<std::uint32_t>(ns)), put<std::uint16_t>(b, 7),
          put<std::uint16_t>(b, 8);
      put<std::uint16_t>(b, 9);
    } else if (sensor == "Avia") {
      put(b, static_cast<std::uint8_t>(s.intensity[i] * 8)), put<std::uint8_t>(b, 1), put<std::uint8_t>(b, 2);
      put(b, static_cast<std::uint32_t>(ns));
    } else if (sensor == "Aeva") {
      put(b, old_aeva ? s.intensity[i] : -1.0F), put(b, 3.0F), put(b, ns), put<std::uint8_t>(b, 4);
      if (!old_aeva) put(b, s.intensity[i]);
    } else {
      put(b, s.intensity[i]), put<std::uint16_t>(b, 5), put(b, static_cast<float>(time_s[i]));
    }
  }
  return b;
}

class HeliprTest : public ::testing::TestWithParam<std::string> {};

TEST_P(HeliprTest, PointsTimesAndPoses) {
  const std::string sensor = GetParam();
  const TemporaryFolder folder;
  // The Aeva's records change after 1691936557946849179.
  const std::int64_t first = 1691936557846849179;
  std::string truth;
  std::vector<double> time_s;
  for (int i = 0; i < 11; ++i) time_s.push_back(0.01 * i);
  for (int k = 0; k < 4; ++k) {
    const std::int64_t stamp = first + k * 100'000'000LL;
    folder.write("Bridge01/LiDAR/" + sensor + "/" + std::to_string(stamp) + ".bin",
                 helipr_bytes(sensor, make_points(11, k), time_s, k < 2));
    truth += std::to_string(stamp) + " " + std::to_string(1000.5 + k) + " 2 3 0 0 0.6 0.8\n";
  }
  folder.write("Bridge01/LiDAR_GT/global_" + sensor + "_gt.txt", truth);
  for (const std::string& spec :
       {std::string("Bridge01"), std::string("Bridge01/LiDAR"), "Bridge01/LiDAR/" + sensor}) {
    const auto source = open_source(folder / spec);
    EXPECT_EQ(source->info().format, "helipr");
    EXPECT_TRUE(source->warnings().empty());
    ASSERT_EQ(source->size(), 4U);
    for (std::size_t k = 0; k < 4; ++k) {
      const Scan scan = source->read(k);
      Scan expected = make_points(11, static_cast<int>(k));
      if (sensor == "Avia")
        for (float& v : expected.intensity) v = std::floor(v * 8);
      test::expect_same_points(scan, expected);
      EXPECT_EQ(scan.utime, (first + static_cast<std::int64_t>(k) * 100'000'000) / 1000);
      EXPECT_EQ(scan.duration_us, 100'000);
      for (std::size_t i = 0; i < 11; ++i) EXPECT_NEAR(scan.time[i], 0.1 * static_cast<double>(i), 1e-6);
      // The pose at the start of the next sweep is the one at the end of this.
      EXPECT_EQ(source->ground_truth()[k].utime, scan.utime_end());
      EXPECT_NEAR(source->ground_truth()[k].pose.translation.x(), 1001.5 + static_cast<double>(k), 1e-6);
      EXPECT_NEAR(source->ground_truth()[k].pose.rotation.z(), 0.6, 1e-9);
    }
  }
}

TEST_P(HeliprTest, Damage) {
  const std::string sensor = GetParam();
  const TemporaryFolder folder;
  const std::vector<double> time_s(250'000, 0.05);
  const std::string good =
      helipr_bytes(sensor, make_points(10), {0, .01, .02, .03, .04, .05, .06, .07, .08, .1}, false);
  const std::string base = "LiDAR/" + sensor + "/169193655";
  folder.write(base + "8000000000.bin", good.substr(0, good.size() - 3));
  folder.write(base + "8100000000.bin", "");
  folder.write(base + "8200000000.bin", helipr_bytes(sensor, make_points(250'000), time_s, false));
  folder.write(base + "8300000000.bin", good);
  const auto source = open_source(folder.path());
  EXPECT_THAT(error_of([&] { source->read(0); }), HasSubstr("truncated"));
  EXPECT_EQ(source->read(1).size(), 0U);
  EXPECT_EQ(source->read(2).size(), 250'000U);
  EXPECT_TRUE(source->read(2).time.empty());  // all times equal: none
  EXPECT_EQ(source->read(3).size(), 10U);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("LiDAR_GT"));
  folder.write("LiDAR_GT/global_" + sensor + "_gt.txt", "1691936558300000000 nan 0 0 0 0 0 1\n12 34\n");
  EXPECT_TRUE(open_source(folder.path())->ground_truth().empty());
}

INSTANTIATE_TEST_SUITE_P(AllSensors, HeliprTest, ::testing::Values("Ouster", "Avia", "Aeva", "Velodyne"),
                         [](const auto& parameter) { return parameter.param; });

TEST(Helipr, SeveralSensorsMustBeChosenFrom) {
  const TemporaryFolder folder;
  for (const std::string sensor : {"Avia", "Aeva"})
    folder.write("LiDAR/" + sensor + "/1691936558000000000.bin",
                 helipr_bytes(sensor, make_points(3), {0, 0.05, 0.1}, false));
  EXPECT_THAT(error_of([&] { open_source(folder.path()); }), HasSubstr("several sensors"));
  SourceOptions options;
  options.topic = "Aeva";
  EXPECT_EQ(open_source(folder.path(), options)->info().sensor, "Aeva");
  EXPECT_EQ(open_source(folder / "LiDAR/Avia")->read(0).size(), 3U);
}

TEST(Helipr, NegativeTimesBeginTheSweepBeforeTheStamp) {
  const TemporaryFolder folder;
  for (int k = 0; k < 3; ++k)
    folder.write("LiDAR/Velodyne/" + std::to_string(1691936558000000000 + k * 100'000'000LL) + ".bin",
                 helipr_bytes("Velodyne", make_points(3), {-0.1, -0.05, 0.0}, false));
  const auto source = open_source(folder.path());
  const Scan scan = source->read(1);
  EXPECT_EQ(scan.utime_end(), 1691936558100000);
  EXPECT_EQ(scan.duration_us, 100'000);
  EXPECT_NEAR(scan.time[1], 0.5, 1e-5);
}

// ---------------------------------------------------------------- Apollo

std::string apollo_pcd(const Scan& s) {
  std::string b =
      "VERSION .7\nFIELDS x y z intensity timestamp\nSIZE 4 4 4 1 8\nTYPE F F F U F\nCOUNT 1 1 1 1 "
      "1\nWIDTH " +
      std::to_string(s.size()) + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + std::to_string(s.size()) +
      "\nDATA binary\n";
  for (std::size_t i = 0; i < s.size(); ++i) {
    put(b, s.x[i]), put(b, s.y[i]), put(b, s.z[i]), put(b, static_cast<std::uint8_t>(i % 200));
    put(b, 1.5e9 + 0.001 * static_cast<double>(i));
  }
  return b;
}

TEST(Apollo, PointsTimesAndPoses) {
  const TemporaryFolder folder;
  std::string truth;
  for (int k = 1; k <= 12; ++k) {
    folder.write("pcds/" + std::to_string(k) + ".pcd", apollo_pcd(make_points(k == 3 ? 250'000 : 10, k)));
    if (k == 5 || k == 12) continue;
    truth += std::to_string(k) + " " + std::to_string(1500000000.0 + 0.1 * k) + " " +
             std::to_string(580000.0 + k) + " 4140000 -20 0 0 0 1\n";
  }
  folder.write("poses/gt_poses.txt", truth);
  const auto source = open_source(folder.path());
  EXPECT_EQ(source->info().format, "apollo");
  ASSERT_EQ(source->size(), 12U);
  const Scan scan = source->read(9);  // 10.pcd comes after 9.pcd
  EXPECT_EQ(scan.x, make_points(10, 10).x);
  EXPECT_EQ(scan.intensity[9], 9.0F);
  EXPECT_TRUE(scan.time.empty());
  EXPECT_EQ(scan.duration_us, 0);
  EXPECT_EQ(scan.utime, 1500000001'000'000);
  EXPECT_EQ(source->read(2).size(), 250'000U);
  EXPECT_EQ(source->read(4).utime, 1500000000'500'000);   // between its neighbours
  EXPECT_EQ(source->read(11).utime, 1500000001'200'000);  // continued
  ASSERT_EQ(source->ground_truth().size(), 10U);
  EXPECT_EQ(source->ground_truth()[4].utime, source->read(5).utime);
  EXPECT_NEAR(source->ground_truth()[4].pose.translation.x(), 580006.0, 1e-9);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("2 of 12"));
}

TEST(Apollo, Damage) {
  const TemporaryFolder folder;
  folder.write("pcds/1.pcd", apollo_pcd(make_points(10)).substr(0, 250));
  folder.write("pcds/2.pcd", apollo_pcd(make_points(10)));
  const auto source = open_source(folder.path());
  EXPECT_THAT(error_of([&] { source->read(0); }), HasSubstr("promises 10 points"));
  EXPECT_EQ(source->read(1).size(), 10U);
  EXPECT_THAT(source->warnings(), ::testing::Contains(HasSubstr("10 scans a second")));
  EXPECT_TRUE(source->ground_truth().empty());
  folder.write("poses/gt_poses.txt", "1 5 nan 0 0 0 0 0 1\n2 5.1 1 2 3 0 0 0 1\nx\n");
  EXPECT_EQ(open_source(folder.path())->ground_truth().size(), 1U);
}

}  // namespace
}  // namespace hp2
