#include "player/sweep/drive_sweep.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.hpp"
#include "player/scan_source.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kScans = 105;

/// What is done to the scans of a synthetic drive, whose sensor turns clockwise from behind.
struct Change {
  bool mirrored = false;     ///< Left for right: the sensor turns counterclockwise.
  bool rings = false;        ///< Points in the order of their rings.
  bool compensated = false;  ///< Points as they would be at the end of the sweep.
  bool keep_times = false;
  bool reverse_times = false;
  double cut_rad = 0.0;  ///< The sensor is mounted turned about its axis by so much.
};

Scan changed(const ScanSource& source, std::size_t i, const Change& change) {
  Scan scan = source.read(i);
  if (change.compensated && i > 0) {
    const auto& truth = source.ground_truth();
    const Vector6d twist = se3_log(truth[i - 1].pose.inverse() * truth[i].pose);
    for (std::size_t k = 0; k < scan.size(); ++k) {
      const Eigen::Vector3d p = se3_exp((static_cast<double>(scan.time[k]) - 1.0) * twist) *
                                Eigen::Vector3d(scan.x[k], scan.y[k], scan.z[k]);
      scan.x[k] = static_cast<float>(p.x());
      scan.y[k] = static_cast<float>(p.y());
      scan.z[k] = static_cast<float>(p.z());
    }
  }
  const auto c = static_cast<float>(std::cos(change.cut_rad)),
             s = static_cast<float>(std::sin(change.cut_rad));
  for (std::size_t k = 0; k < scan.size(); ++k) {
    const float x = scan.x[k], y = change.mirrored ? -scan.y[k] : scan.y[k];
    scan.x[k] = c * x - s * y;
    scan.y[k] = s * x + c * y;
    if (change.reverse_times) scan.time[k] = 1.0F - scan.time[k];
  }
  if (change.rings) {
    std::vector<std::size_t> order(scan.size());
    std::iota(order.begin(), order.end(), 0U);
    const auto beam = [&](std::size_t k) {
      return std::lround(std::atan2(scan.z[k], std::hypot(scan.x[k], scan.y[k])) * 180.0 / M_PI);
    };
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return beam(a) > beam(b); });
    Scan sorted = scan;
    for (std::size_t k = 0; k < order.size(); ++k) {
      sorted.x[k] = scan.x[order[k]];
      sorted.y[k] = scan.y[order[k]];
      sorted.z[k] = scan.z[order[k]];
    }
    scan = sorted;
  }
  if (!change.keep_times) scan.time.clear();
  return scan;
}

/// A drive of scans in memory; without times its stamps are those of the sweeps' middles.
Drive make_drive(const std::string& scene, const Change& change) {
  SourceOptions options;
  options.first = 20;
  options.count = kScans;
  const auto source = open_source(scene, options);
  auto scans = std::make_shared<std::vector<Scan>>();
  Drive drive;
  drive.info.name = scene;
  drive.stamp_in_sweep = 0.5;
  for (std::size_t i = 0; i < source->size(); ++i) {
    scans->push_back(changed(*source, i, change));
    const std::int64_t duration = scans->back().duration_us;
    drive.scans.push_back({"", scans->back().utime + (change.keep_times ? 0 : duration / 2),
                           change.keep_times ? duration : 0, static_cast<std::int64_t>(i)});
    drive.ground_truth.emplace_back(source->ground_truth()[i].pose);
  }
  drive.decode = [scans](const DriveScan& entry, Scan& scan) {
    scan = (*scans)[static_cast<std::size_t>(entry.key)];
  };
  return drive;
}

std::string settled(const std::string& scene, const Change& change) {
  Drive drive = make_drive(scene, change);
  settle_sweep(drive, "auto", 0);
  return drive.warnings.empty() ? "" : drive.warnings.back();
}

TEST(DriveSweep, FindsClockwiseSweepOfDistortedScans) {
  Drive drive = make_drive("synthetic:loop", {});
  const std::int64_t stamp = drive.scans[3].utime;
  const Scan before = [&] {
    Scan scan;
    drive.decode(drive.scans[0], scan);
    return scan;
  }();
  settle_sweep(drive, "auto", 0);
  ASSERT_EQ(drive.warnings.size(), 1U);
  EXPECT_THAT(drive.warnings[0], testing::HasSubstr("turning clockwise from azimuth 180"));
  EXPECT_THAT(drive.sweep, testing::StartsWith("clockwise:"));
  // A run that goes on takes the name in place of the search: its times are the same bit for bit.
  Drive again = make_drive("synthetic:loop", {});
  settle_sweep(again, drive.sweep, 0);
  Scan found, named;
  drive.decode(drive.scans[7], found);
  again.decode(again.scans[7], named);
  EXPECT_EQ(found.time, named.time);
  EXPECT_EQ(drive.scans[3].duration_us, 100'000);
  EXPECT_NEAR(static_cast<double>(drive.scans[3].utime), static_cast<double>(stamp), 50'000.0);
  Scan after;
  drive.decode(drive.scans[0], after);
  ASSERT_EQ(after.time.size(), before.size());
  EXPECT_LT(after.time.front(), 0.01F);
  EXPECT_GT(after.time.back(), 0.99F);
}

TEST(DriveSweep, FindsCounterclockwiseSweep) {
  Change change;
  change.mirrored = true;
  EXPECT_THAT(settled("synthetic:loop", change),
              testing::HasSubstr("turning counterclockwise from azimuth 180"));
}

TEST(DriveSweep, FindsSweepOfRingsCutAtTheSide) {
  Change change;
  change.rings = true;
  change.cut_rad = -0.5 * M_PI;
  const std::string remark = settled("synthetic:loop", change);
  // The right sweep, or none: never a wrong one.
  if (remark.empty()) return;
  EXPECT_THAT(remark, testing::HasSubstr("turning clockwise from azimuth"));
  EXPECT_THAT(remark, testing::HasSubstr("9"));  // 89 to 91
}

TEST(DriveSweep, LeavesCompensatedScansAlone) {
  for (const bool rings : {false, true}) {
    Change change;
    change.compensated = true;
    change.rings = rings;
    EXPECT_THAT(settled("synthetic:loop", change), testing::Not(testing::HasSubstr("turning")));
  }
}

TEST(DriveSweep, NeverDoubtsRightTimes) {
  Change change;
  change.keep_times = true;
  EXPECT_EQ(settled("synthetic:loop", change), "");
}

TEST(DriveSweep, NoticesReversedTimes) {
  Change change;
  change.keep_times = change.reverse_times = true;
  EXPECT_THAT(settled("synthetic:loop", change), testing::HasSubstr("times run backwards"));
}

TEST(DriveSweep, TakesWhatIsChosenByHand) {
  Drive drive = make_drive("synthetic:tiny", {});
  settle_sweep(drive, "counterclockwise:90", 0);
  Scan scan;
  drive.decode(drive.scans[0], scan);
  EXPECT_EQ(scan.time.size(), scan.size());
  EXPECT_THAT(drive.warnings.at(0), testing::HasSubstr("counterclockwise from azimuth 90"));
  Drive other = make_drive("synthetic:tiny", {});
  settle_sweep(other, "given", 0);
  EXPECT_EQ(other.scans[0].duration_us, 0);
  EXPECT_THROW(settle_sweep(other, "sideways", 0), Error);
  EXPECT_THROW(settle_sweep(other, "clockwise:", 0), Error);
}

TEST(DriveSweep, EvensRoundedStampsAndKeepsGaps) {
  std::vector<std::int64_t> exact, rounded;
  for (int i = 0; i < 100; ++i) {
    if (i > 50 && i < 55) continue;
    exact.push_back(static_cast<std::int64_t>(i) * 103'500);
    rounded.push_back((exact.back() + 5'000) / 10'000 * 10'000);
  }
  const std::vector<std::int64_t> even = even_stamps(rounded);
  for (std::size_t i = 0; i < exact.size(); ++i) EXPECT_LT(std::abs(even[i] - exact[i]), 2'000) << i;
}

TEST(DriveSweep, LeavesStampsOfKeyFramesAsTheyAre) {
  const std::vector<std::int64_t> stamps{0,       130'000,   400'000,   450'000,
                                         800'000, 1'300'000, 1'350'000, 2'000'000};
  EXPECT_EQ(even_stamps(stamps), stamps);
}

}  // namespace
}  // namespace hp2
