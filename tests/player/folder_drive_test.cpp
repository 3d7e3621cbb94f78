// KITTI odometry and generic folders: points, stamps and ground truth as written, and every kind of damage.
#include <chrono>
#include <cmath>
#include <limits>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "player/readers/point_file.hpp"
#include "player/scan_source.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::bin_of;
using test::error_of;
using test::make_points;
using test::number;
using test::pose_line;
using test::TemporaryFolder;
using ::testing::HasSubstr;

/// A generic drive of n scans at 10 Hz, with times in the sweep if wanted; the sensor moves 1 m a scan along
/// x.
void write_generic(const TemporaryFolder& folder, std::size_t n, bool ptimes) {
  std::string times, poses;
  for (std::size_t i = 0; i < n; ++i) {
    const Scan scan = make_points(5 + i, static_cast<int>(i));
    folder.write("velodyne/" + number(i) + ".bin", bin_of(scan));
    times += std::to_string(100.0 + 0.1 * static_cast<double>(i)) + "\n";
    poses += pose_line(static_cast<double>(i));
    std::string t;
    for (std::size_t k = 0; k < scan.size(); ++k) test::put(t, static_cast<float>(k) / 16.0F);
    if (ptimes) folder.write("ptimes/" + number(i) + ".bin", t);
  }
  folder.write("times.txt", times);
  folder.write("poses.txt", poses);
}

TEST(FolderDrive, GenericWithoutTimesInSweep) {
  const TemporaryFolder folder;
  write_generic(folder, 4, false);
  const auto source = open_source(folder.path());
  EXPECT_EQ(source->info().format, "generic");
  ASSERT_EQ(source->size(), 4U);
  EXPECT_TRUE(source->warnings().empty());
  for (std::size_t i = 0; i < 4; ++i) {
    const Scan scan = source->read(i);
    test::expect_same_points(scan, make_points(5 + i, static_cast<int>(i)));
    EXPECT_EQ(scan.sequence, static_cast<std::int64_t>(i));
    EXPECT_EQ(scan.utime, 100'000'000 + static_cast<std::int64_t>(i) * 100'000);
    EXPECT_EQ(scan.duration_us, 0);
    EXPECT_TRUE(scan.time.empty());
    EXPECT_EQ(source->ground_truth()[i].utime, scan.utime);
    EXPECT_NEAR(source->ground_truth()[i].pose.translation.x(), static_cast<double>(i), 1e-12);
  }
}

// Nothing of an older scan shows in one that is read into its memory, be it longer or shorter, with or
// without times.
TEST(FolderDrive, MemoryOfAnOlderScanIsUsedAgain) {
  const TemporaryFolder with, without;
  write_generic(with, 4, true);
  write_generic(without, 4, false);
  const auto timed = open_source(with.path()), untimed = open_source(without.path());
  Scan scan;
  for (const std::size_t i : {2U, 0U, 1U}) {
    scan = timed->read(i, std::move(scan));
    test::expect_same_points(scan, make_points(5 + i, static_cast<int>(i)));
    EXPECT_EQ(scan.time, timed->read(i).time);
    EXPECT_EQ(scan.time.size(), scan.size());
    scan = untimed->read(i + 1, std::move(scan));
    test::expect_same_points(scan, make_points(6 + i, static_cast<int>(i + 1)));
    EXPECT_TRUE(scan.time.empty());
  }
}

TEST(FolderDrive, TimesInSweepMakeStartsAndGroundTruthAtTheEnd) {
  const TemporaryFolder folder;
  write_generic(folder, 4, true);
  const auto source = open_source(folder.path());
  const Scan scan = source->read(2);
  EXPECT_EQ(scan.utime, 100'200'000 - 50'000);  // the stamp is the sweep's middle
  EXPECT_EQ(scan.duration_us, 100'000);
  ASSERT_EQ(scan.time.size(), scan.size());
  EXPECT_FLOAT_EQ(scan.time[3], 3.0F / 16.0F);
  ASSERT_EQ(source->ground_truth().size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {  // half a step further than the middle, the last one extrapolated
    EXPECT_EQ(source->ground_truth()[i].utime, source->read(i).utime_end());
    EXPECT_NEAR(source->ground_truth()[i].pose.translation.x(), static_cast<double>(i) + 0.5, 1e-9);
  }
  folder.write("poses_end.txt", pose_line(7) + pose_line(8) + pose_line(9) + pose_line(10));
  EXPECT_NEAR(open_source(folder.path())->ground_truth()[1].pose.translation.x(), 8.0, 1e-12);
}

TEST(FolderDrive, FirstCountStrideKeepTheSweepsLength) {
  const TemporaryFolder folder;
  write_generic(folder, 20, true);
  SourceOptions options;
  options.first = 2;
  options.count = 4;
  options.stride = 3;
  const auto source = open_source(folder.path(), options);
  ASSERT_EQ(source->size(), 4U);
  const Scan scan = source->read(1);  // file 5
  test::expect_same_points(scan, make_points(10, 5));
  EXPECT_EQ(scan.sequence, 1);
  EXPECT_EQ(scan.duration_us, 100'000);
  EXPECT_NEAR(source->ground_truth()[1].pose.translation.x(), 5.5, 1e-9);
  options.first = 20;
  EXPECT_THAT(error_of([&] { open_source(folder.path(), options); }), HasSubstr("no scan is left"));
}

TEST(FolderDrive, ReadsPtimesInOtherUnits) {
  struct Case {
    double first, span;
    std::string remark;
  };
  for (const Case& c :
       {Case{0.0, 1.0, ""}, Case{0.0, 0.1, "seconds"}, Case{0.0, 100.0, "milliseconds"},
        Case{-0.05, 0.1, "seconds"}, Case{-0.5, 1.0, "-0.50..0.50"}, Case{0.5, 1.0, "0.50..1.50"}}) {
    const TemporaryFolder folder;
    write_generic(folder, 4, false);
    for (std::size_t i = 0; i < 4; ++i) {
      std::string t;
      for (std::size_t k = 0; k < 5 + i; ++k)
        test::put(t,
                  static_cast<float>(c.first + c.span * static_cast<double>(k) / static_cast<double>(4 + i)));
      folder.write("ptimes/" + number(i) + ".bin", t);
    }
    const auto source = open_source(folder.path());
    const Scan scan = source->read(1);
    EXPECT_NEAR(static_cast<double>(scan.duration_us), 100'000.0, 1.0) << c.span;
    ASSERT_EQ(scan.time.size(), 6U);
    for (std::size_t k = 0; k < 6; ++k)
      EXPECT_NEAR(scan.time[k], static_cast<float>(k) / 5.0F, 1e-4F) << c.first;
    ASSERT_EQ(source->warnings().size(), c.remark.empty() ? 0U : 1U);
    EXPECT_THAT(testing::PrintToString(source->warnings()), HasSubstr(c.remark));
  }
}

TEST(FolderDrive, DroppedScansDoNotStretchTheSweep) {
  const TemporaryFolder folder;
  std::string times;
  for (std::size_t i = 0, k = 0; i < 40; ++i) {
    if (i % 3 == 2) continue;
    folder.write(number(k) + ".bin", bin_of(make_points(2)));
    folder.write("ptimes/" + number(k) + ".bin", std::string(8, '\0'));
    times += std::to_string(0.1 * static_cast<double>(i) + (i % 2 ? 0.003 : 0.0)) + "\n";
    ++k;
  }
  folder.write("times.txt", times);
  EXPECT_NEAR(static_cast<double>(open_source(folder.path())->read(0).duration_us), 100'000, 4'000);
}

TEST(FolderDrive, KittiCorrectsAnglesAndTurnsGroundTruthIntoTheLidarFrame) {
  const TemporaryFolder folder;
  // Camera: x right, y down, z forward; its origin 0.3 m behind and 0.1 m below the LiDAR's.
  folder.write("sequences/07/calib.txt", "P0: 1 0 0 0 0 1 0 0 0 0 1 0\nTr: 0 -1 0 0 0 0 -1 -0.1 1 0 0 0.3\n");
  folder.write("sequences/07/times.txt", "0\n1.037e-01\n");
  folder.write("sequences/07/velodyne/000000.bin", bin_of(make_points(3)));
  folder.write("sequences/07/velodyne/000001.bin", bin_of(make_points(3)));
  // Camera 2 m forward (its z) and turned left by 90 degrees (-90 about its y).
  folder.write("poses/07.txt", pose_line(0) + "0 0 -1 0 0 1 0 0 1 0 0 2\n");
  const auto source = open_source(folder / "sequences/07");
  EXPECT_EQ(source->info().format, "kitti");
  EXPECT_EQ(source->info().name, "07");
  ASSERT_EQ(source->ground_truth().size(), 2U);
  const Pose pose = source->ground_truth()[1].pose;
  const Eigen::Vector3d ahead = pose.rotation * Eigen::Vector3d::UnitX();
  EXPECT_NEAR(ahead.y(), 1.0, 1e-9);  // the LiDAR looks left, too
  // The LiDAR's origin lies 0.3 m ahead of the camera: at 2 m forward the camera, then 0.3 m to the left of
  // it, as seen from the first LiDAR pose 2 - 0.3 = 1.7 m ahead.
  EXPECT_NEAR(pose.translation.x(), 1.7, 1e-9);
  EXPECT_NEAR(pose.translation.y(), 0.3, 1e-9);
  EXPECT_NEAR(pose.translation.z(), 0.0, 1e-9);

  const Scan raw = make_points(3);
  const Scan read = source->read(1);
  EXPECT_EQ(read.utime, 103'700);
  for (std::size_t i = 0; i < 3; ++i) {
    const Eigen::Vector3d p(raw.x[i], raw.y[i], raw.z[i]);
    const Eigen::Vector3d axis = p.cross(Eigen::Vector3d::UnitZ()).normalized();
    const Eigen::Vector3d q = Eigen::AngleAxisd(0.205 * M_PI / 180.0, axis) * p;
    EXPECT_NEAR(read.x[i], q.x(), 1e-6);
    EXPECT_NEAR(read.y[i], q.y(), 1e-6);
    EXPECT_NEAR(read.z[i], q.z(), 1e-6);
  }
  SourceOptions off;
  off.kitti_correction = 0;
  test::expect_same_points(open_source(folder / "sequences/07", off)->read(1), raw);

  SensorCalibration calibration;  // the front-end corrects by it: not twice
  SourceOptions with_calibration, without;
  leave_angles_to(calibration, without);
  calibration.vertical_angle_bias_deg = 0.2;
  leave_angles_to(calibration, with_calibration);
  test::expect_same_points(open_source(folder / "sequences/07", without)->read(1), read);
  test::expect_same_points(open_source(folder / "sequences/07", with_calibration)->read(1), raw);
}

TEST(FolderDrive, MissingScansTakeTheLinesOfTheirNumbers) {
  const TemporaryFolder folder;
  for (const std::size_t i : {0U, 1U, 4U})
    folder.write("velodyne/" + number(i) + ".bin", bin_of(make_points(2)));
  folder.write("times.txt", "0\n0.1\n0.2\n0.3\n0.4\n");
  folder.write("poses.txt", pose_line(0) + pose_line(1) + pose_line(2) + pose_line(3) + pose_line(4));
  const auto source = open_source(folder.path());
  EXPECT_EQ(source->read(2).utime, 400'000);
  EXPECT_NEAR(source->ground_truth()[2].pose.translation.x(), 4.0, 1e-12);
}

TEST(FolderDrive, BadTimesAreMendedOrTenHertzAndReported) {
  for (const std::string times :
       {"0\n0.1\n0.05\n", "5\n5\n5\n", "0\nnan\n0.2\n", "0\n0.1\ninf\n", "0\n0.1\n1e300\n", ""}) {
    const TemporaryFolder folder;
    write_generic(folder, 3, true);
    folder.write("times.txt", times);
    const auto source = open_source(folder.path());
    EXPECT_FALSE(source->warnings().empty()) << times;
    EXPECT_EQ(source->read(2).utime - source->read(1).utime, 100'000) << times;
    EXPECT_EQ(source->read(2).duration_us, 100'000) << times;
  }
}

TEST(FolderDrive, ReadsTimesInOtherUnitsAndForms) {
  const std::string iso = "2020-09-13T12:26:40.05Z\n2020-09-13T12:26:40.15Z\n2020-09-13T12:26:40.25Z\n";
  for (const std::string times :
       {"1600000000.05\n1600000000.15\n1600000000.25\n", "1600000000050\n1600000000150\n1600000000250\n",
        "1600000000050000\n1600000000150000\n1600000000250000\n",
        "1600000000050000000\n1600000000150000000\n1600000000250000000\n",
        "\xef\xbb\xbf# seconds\r\n1600000000.05\r\n1600000000.15\r\n1600000000.25\r\n",
        "frame,timestamp\n0,1600000000.05\n1,1600000000.15\n2,1600000000.25\n",
        "1600000000 50000000\n1600000000 150000000\n1600000000 250000000\n", iso.c_str()}) {
    const TemporaryFolder folder;
    write_generic(folder, 3, true);
    folder.write("times.txt", times);
    const auto source = open_source(folder.path());
    EXPECT_NEAR(static_cast<double>(source->read(1).utime), 1'600'000'000'100'000.0, 1.0) << times;
    EXPECT_EQ(source->read(2).utime_end() - source->read(1).utime_end(), 100'000) << times;
  }
}

TEST(FolderDrive, LeavesOutCopiesAndKeepsLinesOfPosesWithTheirScans) {
  const TemporaryFolder folder;
  write_generic(folder, 12, true);
  std::string times;
  for (int i = 0; i < 12; ++i) times += std::to_string(100.0 + 0.1 * (i >= 6 ? i - 1 : i)) + "\n";
  folder.write("times.txt", times);  // file 6 is a copy of file 5, with its stamp
  folder.write("velodyne/000006.bin", bin_of(make_points(10, 5)));
  const auto source = open_source(folder.path());
  ASSERT_EQ(source->size(), 11U);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("1 scan (scan 6) with the same stamp and points"));
  test::expect_same_points(source->read(6), make_points(12, 7));
  EXPECT_NEAR(source->ground_truth()[6].pose.translation.x(), 7.5, 0.3);
}

TEST(FolderDrive, ReadsGroundTruthOfTimesAndPoses) {
  const TemporaryFolder folder;
  write_generic(folder, 4, true);
  std::string poses = "# time x y z qx qy qz qw\n";
  for (int i = 0; i < 8; ++i)
    poses += std::to_string(99.95 + 0.1 * i) + " " + std::to_string(i) + " 0 0 0 0 0 1\n";
  folder.write("poses.txt", poses);
  const auto source = open_source(folder.path());
  EXPECT_TRUE(source->warnings().empty());
  ASSERT_EQ(source->ground_truth().size(), 4U);  // sweep 0 ends at 100.05
  EXPECT_NEAR(source->ground_truth()[2].pose.translation.x(), 3.0, 1e-5);
  folder.write("poses.txt", "5000 0 0 0 0 0 0 1\n5001 0 0 0 0 0 0 1\n");
  EXPECT_THAT(open_source(folder.path())->warnings().at(0), HasSubstr("not of the scans' clock"));
}

TEST(FolderDrive, ShortOrBrokenPosesCoverWhatTheyCover) {
  const TemporaryFolder folder;
  write_generic(folder, 4, false);
  folder.write("poses.txt", pose_line(0) + "nan 0 0 0 0 1 0 0 0 0 1 0\n" + pose_line(2));
  const auto source = open_source(folder.path());
  ASSERT_EQ(source->ground_truth().size(), 2U);
  EXPECT_EQ(source->ground_truth()[1].utime, source->read(2).utime);
  EXPECT_THAT(source->warnings().at(0), HasSubstr("2 of 4"));
  folder.write("poses.txt", "what is this\n");
  EXPECT_TRUE(open_source(folder.path())->ground_truth().empty());
}

TEST(FolderDrive, WhatIsNotThereIsSaid) {
  const TemporaryFolder folder;
  EXPECT_THAT(error_of([&] { open_source(folder / "nowhere"); }), HasSubstr("no such folder"));
  EXPECT_THAT(error_of([&] { open_source(folder.path()); }), HasSubstr("no scan"));
  std::filesystem::create_directories(folder / "velodyne");
  EXPECT_THAT(error_of([&] { open_source(folder.path()); }), HasSubstr("no scan"));
  SourceOptions options;
  options.dataset = "kity";
  EXPECT_THAT(error_of([&] { open_source(folder.path(), options); }),
              HasSubstr("unknown data set format: kity"));
}

TEST(FolderDrive, DamagedScans) {
  const TemporaryFolder folder;
  write_generic(folder, 4, true);
  folder.write("velodyne/000001.bin", bin_of(make_points(3)).substr(0, 41));
  folder.write("velodyne/000002.bin", "");
  folder.write("ptimes/000002.bin", "");
  Scan nan = make_points(3);
  nan.x[1] = std::numeric_limits<float>::quiet_NaN();
  folder.write("velodyne/000003.bin", bin_of(nan));
  const auto source = open_source(folder.path());
  EXPECT_THAT(error_of([&] { source->read(1); }),
              ::testing::AllOf(HasSubstr("truncated"), HasSubstr("000001.bin")));
  EXPECT_EQ(source->read(2).size(), 0U);
  EXPECT_THAT(error_of([&] { source->read(3); }), HasSubstr("do not fit"));  // ptimes of 8 points
  EXPECT_NE(error_of([&] { source->read(4); }), "");
  std::filesystem::remove_all(folder / "ptimes");
  EXPECT_TRUE(std::isnan(open_source(folder.path())->read(3).x[1]));
}

TEST(FolderDrive, VelodyneFolderItself) {
  const TemporaryFolder folder;
  write_generic(folder, 3, false);
  EXPECT_EQ(open_source(folder / "velodyne")->ground_truth().size(), 3U);
  EXPECT_EQ(open_source(folder / "velodyne/")->read(1).utime, 100'100'000);
}

TEST(FolderDrive, ScansOfAnySize) {
  const TemporaryFolder folder;
  folder.write("a2.bin", bin_of(make_points(10)));
  Scan large = make_points(250'000);
  for (auto* axis : {&large.x, &large.y, &large.z})  // as far as a sensor sees
    for (float& v : *axis) v = std::fmod(v, 64.0F);
  folder.write("a10.bin", bin_of(large));
  const auto source = open_source(folder.path());
  test::expect_same_points(source->read(0), make_points(10));  // a2 before a10
  test::expect_same_points(source->read(1), large);
}

}  // namespace
}  // namespace hp2
