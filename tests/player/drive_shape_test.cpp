// The unit of lengths, sweeps in parts, and damaged scans: recognised from what the scans hold.
#include "player/sweep/drive_shape.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::error_of;
using ::testing::HasSubstr;

constexpr int kColumns = 720;  // of a turn

/// Columns [begin, end) of a turn inside of a wall 8 to 12 units of `metre` away, with a time in the part.
Scan part_of_turn(int begin, int end, double metre, bool timed) {
  Scan scan;
  for (int c = begin; c < end; ++c) {
    const double azimuth = -2.0 * M_PI * c / kColumns;  // clockwise
    const double range = metre * (10.0 + 2.0 * std::sin(3.0 * azimuth));
    scan.x.push_back(static_cast<float>(range * std::cos(azimuth)));
    scan.y.push_back(static_cast<float>(range * std::sin(azimuth)));
    scan.z.push_back(static_cast<float>(0.1 * metre));
    if (timed) scan.time.push_back(static_cast<float>(c - begin) / static_cast<float>(end - begin));
  }
  return scan;
}

/// n scans of 360 / parts degrees each, ten turns per second.
Drive drive_in_parts(std::size_t n, int parts, double metre = 1.0, bool timed = true) {
  Drive drive;
  drive.info.path = "drive";
  for (std::size_t i = 0; i < n; ++i) {
    const auto begin = static_cast<std::int64_t>(i) * 100'000 / parts;
    drive.scans.push_back({"", begin, timed ? 100'000 / parts : 0, static_cast<std::int64_t>(i)});
  }
  drive.decode = [parts, metre, timed](const DriveScan& entry, Scan& scan) {
    const int k = static_cast<int>(entry.key) % parts;
    Scan made = part_of_turn(k * kColumns / parts, (k + 1) * kColumns / parts, metre, timed);
    made.utime = scan.utime;
    made.duration_us = scan.duration_us;
    scan = std::move(made);
  };
  return drive;
}

TEST(DriveShape, JoinsPartsOfSweeps) {
  for (const int parts : {2, 3, 4, 12, 36})
    for (const bool timed : {true, false}) {
      SCOPED_TRACE(parts);
      Drive drive = drive_in_parts(static_cast<std::size_t>(6 * parts), parts, 1.0, timed);
      join_parts(drive);
      ASSERT_EQ(drive.scans.size(), 6U);
      EXPECT_THAT(drive.warnings.at(0), HasSubstr("6 sweeps are put together"));
      EXPECT_NEAR(static_cast<double>(drive.scans[3].utime), 300'000, 1.0);
      EXPECT_NEAR(static_cast<double>(drive.scans[3].duration_us), 100'000, 100.0);
      Scan sweep;
      sweep.utime = drive.scans[3].utime;
      sweep.duration_us = drive.scans[3].duration_us;
      drive.decode(drive.scans[3], sweep);
      ASSERT_EQ(sweep.size(), static_cast<std::size_t>(kColumns));
      ASSERT_EQ(sweep.time.size(), sweep.size());
      const double error = timed ? 0.002 : 0.6 / parts;
      for (std::size_t c = 0; c < sweep.size(); ++c)
        ASSERT_NEAR(sweep.time[c], static_cast<double>(c) / kColumns, error) << c;
    }
}

TEST(DriveShape, MissingPartsDoNotShiftTheSweeps) {
  Drive drive = drive_in_parts(120, 12);
  drive.scans.erase(drive.scans.begin() + 30, drive.scans.begin() + 33);
  join_parts(drive);
  ASSERT_EQ(drive.scans.size(), 10U);
  EXPECT_NEAR(static_cast<double>(drive.scans[5].utime), 500'000, 1.0);
}

TEST(DriveShape, LeavesWholeScansAndForwardViewsAlone) {
  Drive whole = drive_in_parts(30, 1);
  join_parts(whole);
  EXPECT_EQ(whole.scans.size(), 30U);
  Drive ahead = drive_in_parts(60, 12);
  ahead.decode = [](const DriveScan&, Scan& scan) { scan = part_of_turn(0, 100, 1.0, true); };
  join_parts(ahead);
  EXPECT_EQ(ahead.scans.size(), 60U);
  EXPECT_TRUE(ahead.warnings.empty());
}

TEST(DriveShape, RecognisesMillimetres) {
  for (const auto& [metre, expected] :
       {std::pair(1.0, 10.0), std::pair(1000.0, 10.0), std::pair(30.0, 300.0)}) {
    Drive drive = drive_in_parts(5, 1, metre);
    settle_length_unit(drive);
    EXPECT_EQ(drive.warnings.size(), metre == 1000.0 ? 1U : 0U);
    Scan scan;
    drive.decode(drive.scans[0], scan);
    EXPECT_NEAR(scan.x[0], expected, 0.1);
  }
  Drive given = drive_in_parts(5, 1, 1000.0);
  settle_length_unit(given, "m");
  EXPECT_TRUE(given.warnings.empty());
  Drive garbage = drive_in_parts(5, 1, 1e12);
  EXPECT_THAT(error_of([&] { settle_length_unit(garbage); }), HasSubstr("no LiDAR's"));
}

TEST(DriveShape, DamagedScansAreLeftOutWhenAsked) {
  Drive drive = drive_in_parts(5, 1);
  drive.decode = [inner = drive.decode](const DriveScan& entry, Scan& scan) {
    inner(entry, scan);
    if (entry.key == 2) throw Error("the scan is truncated", "2.pcd", "Copy it again.");
  };
  SourceOptions options;
  EXPECT_NE(error_of([&] { make_source(drive, options)->read(2); }), "");
  options.skip_damaged = true;
  const auto source = make_source(drive, options);
  EXPECT_EQ(source->read(2).size(), 0U);
  EXPECT_EQ(source->read(2).utime, 200'000);
  EXPECT_EQ(source->read(3).size(), static_cast<std::size_t>(kColumns));
  ASSERT_EQ(source->damaged().size(), 1U);
  EXPECT_THAT(source->damaged()[0], HasSubstr("scan 2 is left out: the scan is truncated"));
}

}  // namespace
}  // namespace hp2
