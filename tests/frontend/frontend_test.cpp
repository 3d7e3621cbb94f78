// The whole front-end on a made-up drive with exact ground truth.
#include "frontend/frontend.hpp"

#include <set>

#include <gtest/gtest.h>

#include "tests/frontend/tiny_drive.hpp"

namespace hp2 {
namespace {

using test::tiny_drive;

class FrontendModes : public ::testing::TestWithParam<std::string> {};

TEST_P(FrontendModes, FollowsGroundTruth) {
  Frontend frontend(test::short_submaps(GetParam()));
  const auto out = test::run(frontend, tiny_drive().scans);
  double travelled = 0.0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const OdometryResult& o = out[i].odometry;
    const Pose off = tiny_drive().truth[i].inverse() * o.odom_from_sensor;
    if (i > 0)
      travelled += (tiny_drive().truth[i].translation - tiny_drive().truth[i - 1].translation).norm();
    EXPECT_LT(off.translation.norm(), 0.15 + 0.02 * travelled) << "scan " << i;
    EXPECT_LT(rotation_angle(off.rotation), 0.02) << "scan " << i;
    EXPECT_EQ(o.sequence, tiny_drive().scans[i].sequence);
    EXPECT_EQ(o.utime, tiny_drive().scans[i].utime_end());
    EXPECT_NE(o.state, TrackingState::kLost);
    EXPECT_EQ(o.n_points, static_cast<int>(tiny_drive().scans[i].size()));
    EXPECT_EQ(o.n_skipped, 0);
    EXPECT_TRUE(o.covariance.allFinite());
    if (i > 0) {
      EXPECT_GT(o.n_planar + o.n_non_planar, 50);
    }
  }
  EXPECT_GT(travelled, 10.0);
}

TEST_P(FrontendModes, BitForBitTheSameInEveryRunAndWithTwoThreads) {
  const FrontendConfig config = test::short_submaps(GetParam());
  Frontend a(config, 1), b(config, 1), c(config, 2);
  for (const Scan& scan : tiny_drive().scans) {
    const FrontendOutput x = a.process(scan);
    for (const FrontendOutput& y : {b.process(scan), c.process(scan)}) {
      ASSERT_TRUE(test::same_bits(x.odometry.odom_from_sensor, y.odometry.odom_from_sensor));
      ASSERT_TRUE(test::same_bits(x.odometry.submap_from_sensor, y.odometry.submap_from_sensor));
      ASSERT_EQ(x.odometry.covariance, y.odometry.covariance);
      ASSERT_EQ(x.odometry.diagnostics.sigma, y.odometry.diagnostics.sigma);
      ASSERT_EQ(x.odometry.n_planar, y.odometry.n_planar);
      ASSERT_EQ(x.finished_submap.has_value(), y.finished_submap.has_value());
      if (!x.finished_submap) continue;
      ASSERT_EQ(x.finished_submap->points, y.finished_submap->points);
      ASSERT_EQ(x.finished_submap->scan_indices, y.finished_submap->scan_indices);
    }
  }
}

TEST(Frontend, CorrectsScansByTheCalibrationOfTheSensor) {
  FrontendConfig config = test::short_submaps();
  Frontend plain(config);
  config.sensor.vertical_angle_bias_deg = 2.0;
  Frontend correcting(config);
  config.sensor.ring_angles_deg = {80.0, 85.0};  // of another sensor
  Frontend other(config);
  for (std::size_t i = 0; i < 10; ++i) {
    const Scan& scan = tiny_drive().scans[i];
    Scan lowered = scan;
    raise_vertical_angles(lowered, -2.0 * M_PI / 180.0);
    const Pose expected = plain.process(scan).odometry.odom_from_sensor;
    const Pose pose = correcting.process(lowered).odometry.odom_from_sensor;
    EXPECT_LT((pose.translation - expected.translation).norm(), 0.01) << "scan " << i;
    other.process(scan);
  }
  EXPECT_TRUE(correcting.take_warnings().empty());
  const auto warnings = other.take_warnings();
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_NE(warnings[0].find("another sensor"), std::string::npos);
}

TEST_P(FrontendModes, GoesOnFromASavedStateAsIfNeverInterrupted) {
  const FrontendConfig config = test::short_submaps(GetParam());
  Frontend whole(config);
  std::vector<FrontendOutput> out;
  std::vector<std::pair<std::size_t, std::vector<std::uint8_t>>> saved;  // next scan, state
  saved.emplace_back(0, whole.save_state());
  for (const Scan& scan : tiny_drive().scans) {
    out.push_back(whole.process(scan));
    if (out.back().finished_submap) saved.emplace_back(out.size(), whole.save_state());
  }
  ASSERT_GE(saved.size(), 3U);
  for (const auto& [next, state] : saved) {
    Frontend other(config);
    other.restore_state(state);
    EXPECT_EQ(other.save_state(), state);
    for (std::size_t i = next; i < tiny_drive().scans.size(); ++i) {
      const FrontendOutput o = other.process(tiny_drive().scans[i]);
      ASSERT_TRUE(test::same_bits(o.odometry.odom_from_sensor, out[i].odometry.odom_from_sensor)) << i;
      ASSERT_TRUE(test::same_bits(o.odometry.submap_from_sensor, out[i].odometry.submap_from_sensor)) << i;
      ASSERT_EQ(o.odometry.submap_id, out[i].odometry.submap_id);
      ASSERT_EQ(o.odometry.covariance, out[i].odometry.covariance);
      ASSERT_EQ(o.odometry.n_skipped, 0);
      ASSERT_EQ(o.finished_submap.has_value(), out[i].finished_submap.has_value());
      if (o.finished_submap) {
        ASSERT_EQ(o.finished_submap->points, out[i].finished_submap->points);
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Modes, FrontendModes, ::testing::Values("hybrid", "robust", "point_to_point"),
                         [](const auto& mode) { return mode.param; });

TEST(Frontend, EveryScanIsInExactlyOneSubmap) {
  Frontend frontend(test::short_submaps());
  std::vector<Submap> submaps;
  std::vector<OdometryResult> results;
  for (std::size_t i = 0; i < tiny_drive().scans.size(); ++i) {
    if (i == 11 || i == 12) continue;  // two scans never arrive
    FrontendOutput o = frontend.process(tiny_drive().scans[i]);
    EXPECT_EQ(o.odometry.n_skipped, i == 13 ? 2 : 0);
    for (const OdometryResult& r : o.revised) {
      for (OdometryResult& before : results) {
        if (before.sequence == r.sequence) before = r;
      }
    }
    results.push_back(o.odometry);
    if (o.finished_submap) submaps.push_back(std::move(*o.finished_submap));
  }
  if (auto last = frontend.finish()) submaps.push_back(std::move(*last));
  EXPECT_FALSE(frontend.finish().has_value());
  std::int64_t skipped = 0;
  std::size_t i = 0;
  for (const Submap& m : submaps) {
    skipped += m.scans_skipped;
    EXPECT_FALSE(m.points.empty());
    for (const ScanPose& s : m.scans) {
      ASSERT_LT(i, results.size());
      EXPECT_EQ(s.sequence, results[i].sequence);
      EXPECT_EQ(s.utime, results[i].utime);
      EXPECT_EQ(m.id, results[i].submap_id);
      EXPECT_TRUE(test::same_bits(s.submap_from_sensor, results[i].submap_from_sensor));
      const Pose odom_from_sensor = m.odom_from_submap * s.submap_from_sensor;
      EXPECT_LT((odom_from_sensor.translation - results[i].odom_from_sensor.translation).norm(), 1e-9);
      ++i;
    }
  }
  EXPECT_EQ(i, results.size());
  EXPECT_EQ(skipped, 2);
  EXPECT_GE(submaps.size(), 2U);
}

TEST(Frontend, DroppedScansAreBridgedByTheClock) {
  // Every third scan only: predictions must follow the time stamps, not the number of scans.
  Frontend frontend(test::short_submaps());
  for (std::size_t i = 0; i < tiny_drive().scans.size(); i += (i > 20 ? 3 : 1)) {
    const OdometryResult o = frontend.process(tiny_drive().scans[i]).odometry;
    const Pose off = tiny_drive().truth[i].inverse() * o.odom_from_sensor;
    EXPECT_LT(off.translation.norm(), 0.5) << "scan " << i;
    EXPECT_NE(o.state, TrackingState::kLost);
  }
}

TEST(Frontend, ATurnThatBeganBehindDroppedScansIsFollowed) {
  // Four scans are missing, and the sensor has turned by 9 degrees meanwhile: far beyond what sigma, small
  // by then, lets registration see from the prediction.
  constexpr std::size_t kBefore = 20, kAfter = 24;
  Frontend frontend{FrontendConfig()};
  for (std::size_t i = 0; i < kBefore; ++i) frontend.process(tiny_drive().scans[i]);
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(0.15, Eigen::Vector3d::UnitZ()));
  Scan turned = tiny_drive().scans[kAfter];
  for (std::size_t k = 0; k < turned.size(); ++k) {
    const Eigen::Vector3d p = turn.conjugate() * Eigen::Vector3d(turned.x[k], turned.y[k], turned.z[k]);
    turned.x[k] = static_cast<float>(p.x());
    turned.y[k] = static_cast<float>(p.y());
  }
  const OdometryResult o = frontend.process(turned).odometry;
  const Pose off =
      (tiny_drive().truth[kAfter] * Pose(turn, Eigen::Vector3d::Zero())).inverse() * o.odom_from_sensor;
  EXPECT_LT(off.translation.norm(), 0.3);
  EXPECT_LT(rotation_angle(off.rotation), 0.05);
}

// A plate above everything else: it has no part in registration until the map has it.
Scan with_plate(Scan scan) {
  test::Dice dice(5);
  for (int i = 0; i < 600; ++i) {
    scan.x.push_back(static_cast<float>(dice.uniform(-6, 6)));
    scan.y.push_back(static_cast<float>(dice.uniform(-6, 6)));
    scan.z.push_back(40.0F);
    if (!scan.intensity.empty()) scan.intensity.push_back(0.0F);
    if (!scan.time.empty()) scan.time.push_back(1.0F);
  }
  return scan;
}

// Correspondences of scan 24 that it has for the plate alone, which it and scan 23 see.
int on_the_plate(std::size_t last_before, const std::string& mode, bool timed) {
  constexpr std::size_t kFirst = 23;
  int count[2] = {};
  for (const bool plate : {false, true}) {
    FrontendConfig config;
    config.mode = mode;
    Frontend frontend(config);
    const auto process = [&](std::size_t i) {
      Scan scan = tiny_drive().scans[i];
      if (plate && i >= kFirst) scan = with_plate(scan);
      if (!timed) scan.time.clear();
      const OdometryResult o = frontend.process(scan).odometry;
      return o.n_planar + o.n_non_planar;
    };
    for (std::size_t i = 0; i <= last_before; ++i) process(i);
    process(kFirst);
    count[plate ? 1 : 0] = process(kFirst + 1);
  }
  return count[1] - count[0];
}

TEST(Frontend, AScanBehindDroppedOnesStaysOutOfTheMap) {
  EXPECT_GT(on_the_plate(22, "robust", true), 50);
  EXPECT_LT(on_the_plate(20, "robust", true), 10);
  // Nothing is guessed where points have no times; and the paper's modes take every scan.
  EXPECT_GT(on_the_plate(20, "robust", false), 50);
  EXPECT_GT(on_the_plate(20, "hybrid", true), 50);
}

TEST(Frontend, SaysThatItIsLostAfterAGapAndTracksFromThereOn) {
  constexpr std::size_t kBefore = 30, kGap = 50, kAfter = 20;
  const auto source = open_source("synthetic:block");
  ASSERT_GT(source->size(), kBefore + kGap + kAfter);
  Frontend frontend{FrontendConfig()};
  const auto truth = [&](std::size_t i) { return source->ground_truth()[i].pose; };
  for (std::size_t i = 0; i < kBefore; ++i) {
    EXPECT_NE(frontend.process(source->read(i)).odometry.state, TrackingState::kLost);
  }
  EXPECT_TRUE(frontend.take_warnings().empty());
  std::size_t last = 0;
  Pose last_pose;
  Frontend resumed{FrontendConfig()};
  for (std::size_t i = kBefore + kGap; i < kBefore + kGap + kAfter; ++i) {
    const FrontendOutput out = frontend.process(source->read(i));
    const OdometryResult& o = out.odometry;
    if (i == kBefore + kGap) {
      // The submap ends here, and a front-end that dies now starts as this one does: at unknown speed.
      ASSERT_TRUE(out.finished_submap.has_value());
      resumed.restore_state(frontend.save_state());
      EXPECT_EQ(o.state, TrackingState::kLost);
      EXPECT_GE(o.covariance(0, 0), 1.0);
      const auto warnings = frontend.take_warnings();
      ASSERT_EQ(warnings.size(), 1U);
      EXPECT_NE(warnings[0].find("lost"), std::string::npos);
    } else {
      EXPECT_NE(o.state, TrackingState::kLost) << "scan " << i;
      const FrontendOutput same = resumed.process(source->read(i));
      EXPECT_TRUE(test::same_bits(o.odom_from_sensor, same.odometry.odom_from_sensor));
      EXPECT_EQ(out.revised.size(), same.revised.size());
      EXPECT_EQ(out.finished_submap.has_value(), same.finished_submap.has_value());
      const Pose moved = last_pose.inverse() * o.odom_from_sensor;
      const Pose off = (truth(last).inverse() * truth(i)).inverse() * moved;
      EXPECT_LT(off.translation.norm(), 0.15) << "scan " << i;
    }
    last = i;
    last_pose = o.odom_from_sensor;
  }
}

TEST(Frontend, AGapWithoutMotionIsNoLoss) {
  Frontend frontend{FrontendConfig()};
  for (std::size_t i = 0; i < 20; ++i) frontend.process(tiny_drive().scans[i]);
  Scan later = tiny_drive().scans[20];
  later.utime += 6'000'000;
  const OdometryResult o = frontend.process(later).odometry;
  EXPECT_NE(o.state, TrackingState::kLost);
  const Pose off = tiny_drive().truth[20].inverse() * o.odom_from_sensor;
  EXPECT_LT(off.translation.norm(), 0.4);
}

}  // namespace
}  // namespace hp2
