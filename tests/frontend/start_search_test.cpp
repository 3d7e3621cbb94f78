// A start at full speed where hardly anything tells the speed.
#include "frontend/odometry/start_search.hpp"

#include <algorithm>

#include <gtest/gtest.h>

#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using test::Cloud;
using test::Dice;

constexpr double kStep = 2.0;  // [m] a scan
constexpr int kScans = 16;     // that the search waits for

// 200 m of deck and railings along x with a lamp every 9 m or so; another half of its points in every scan.
const Cloud& bridge() {
  static const Cloud cloud = [] {
    Dice dice(5);
    Cloud c;
    test::add_patch(c, dice, 60000, {-50, -4, -2}, {200, 0, 0}, {0, 8, 0});
    for (const double y : {-4.0, 4.0})
      test::add_patch(c, dice, 20000, {-50, y, -2}, {200, 0, 0}, {0, 0, 1.2});
    for (int i = 0; i < 22; ++i) {
      const double x = -50.0 + 9.0 * i + dice.uniform(-3, 3), y = i % 2 == 0 ? 4.0 : -4.3;
      test::add_patch(c, dice, 600, {x, y, -2}, {0.3, 0, 0}, {0, 0, 6});
      test::add_patch(c, dice, 600, {x, y, -2}, {0, 0.3, 0}, {0, 0, 6});
    }
    return c;
  }();
  return cloud;
}

Scan bridge_scan(int i, double x) {
  Dice dice(100 + static_cast<unsigned>(i));
  Scan scan;
  scan.sequence = i;
  scan.utime = 1'000'000 + 100'000 * i;
  const Eigen::Vector3f at(static_cast<float>(x), 0.0F, 0.0F);
  for (const auto& p : bridge()) {
    const Eigen::Vector3f q = p - at;
    if (q.norm() > 30.0F || dice.uniform(0, 1) < 0.5) continue;
    scan.x.push_back(q.x());
    scan.y.push_back(q.y());
    scan.z.push_back(q.z());
  }
  return scan;
}

Scan bridge_scan(int i) { return bridge_scan(i, kStep * i); }

StampedCloud stamped(const Scan& scan, const Parallel& parallel) {
  const FrontendConfig c;
  Preprocessor preprocessor({c.min_range_m, c.max_range_m, c.map_point_voxel_m, c.source_voxel_m});
  StampedCloud out;
  preprocessor.run(scan, false, parallel, out.cloud);
  out.sequence = scan.sequence;
  out.utime = scan.utime_end();
  return out;
}

Scan room_scan(int i) {
  Scan scan;
  scan.sequence = i;
  scan.utime = 1'000'000 + 100'000 * i;
  const Pose at(Eigen::Quaterniond::Identity(), {0.2 * i - 2.0, 0, 0});
  for (const auto& p : test::seen_from(test::room(9), at)) {
    scan.x.push_back(p.x());
    scan.y.push_back(p.y());
    scan.z.push_back(p.z());
  }
  return scan;
}

TEST(StartSearch, FindsTheSpeedThatATrackHasMissed) {
  const Parallel parallel(2);
  Remarks remarks;
  Track followed{FrontendConfig()};
  followed.process(stamped(bridge_scan(0), parallel), parallel, remarks, true);
  ASSERT_TRUE(followed.at_start());
  StartSearch search;
  search.begin(followed);
  followed.start_with(Vector6d::Zero(), 0, parallel);  // as if it stood still
  for (int i = 1; i < kScans; ++i) {
    const StampedCloud scan = stamped(bridge_scan(i), parallel);
    const TrackingState state = followed.process(scan, parallel, remarks, true).odometry.state;
    EXPECT_EQ(search.add(scan, state, followed), i + 1 == kScans);
  }
  const double missed = kStep * (kScans - 1) - followed.last_pose().translation.x();
  ASSERT_GT(missed, 1.0) << "nothing was missed: the test is void";
  auto found = search.find(followed, parallel);
  ASSERT_TRUE(found.has_value());
  // The present stays, the past is moved.
  EXPECT_LT((found->track.last_pose().translation - followed.last_pose().translation).norm(), 1e-9);
  ASSERT_EQ(found->results.size(), std::size_t{kScans - 1});
  const auto& scans = found->track.builder().open_scans();
  ASSERT_EQ(scans.size(), std::size_t{kScans});
  const Pose& keypose = found->track.builder().odom_from_submap();
  EXPECT_NEAR(keypose.translation.x(), -missed, 0.3);
  for (std::size_t i = 1; i < scans.size(); ++i) {
    const Pose step = scans[i - 1].submap_from_sensor.inverse() * scans[i].submap_from_sensor;
    EXPECT_LT((step.translation - Eigen::Vector3d(kStep, 0, 0)).norm(), 0.15) << "scan " << i;
    const Pose& said = found->results[i - 1].odom_from_sensor;
    EXPECT_LT(((keypose * scans[i].submap_from_sensor).translation - said.translation).norm(), 1e-9);
  }
  // And it goes on from there.
  const OdometryResult next =
      found->track.process(stamped(bridge_scan(kScans), parallel), parallel, remarks, false).odometry;
  const Pose step = found->results.back().odom_from_sensor.inverse() * next.odom_from_sensor;
  EXPECT_LT((step.translation - Eigen::Vector3d(kStep, 0, 0)).norm(), 0.1);
}

TEST(StartSearch, LeavesAWellObservedStartAlone) {
  const Parallel parallel(1);
  Remarks remarks;
  Track followed{FrontendConfig()};
  StartSearch search;
  followed.process(stamped(room_scan(0), parallel), parallel, remarks, true);
  search.begin(followed);
  for (int i = 1; i < kScans; ++i) {
    const StampedCloud scan = stamped(room_scan(i), parallel);
    search.add(scan, followed.process(scan, parallel, remarks, true).odometry.state, followed);
  }
  EXPECT_FALSE(search.find(followed, parallel).has_value());
}

TEST(StartSearch, AClockThatStandsStillIsNoSpeed) {
  const Parallel parallel(1);
  Remarks remarks;
  Track followed{FrontendConfig()};
  StartSearch search;
  for (int i = 0; i < kScans; ++i) {
    StampedCloud scan = stamped(bridge_scan(i), parallel);
    scan.utime = 5;
    const TrackingState state = followed.process(scan, parallel, remarks, true).odometry.state;
    if (i == 0) {
      search.begin(followed);
    } else {
      search.add(scan, state, followed);
    }
  }
  EXPECT_FALSE(search.find(followed, parallel).has_value());
}

TEST(Track, GoesOnTheSameAfterItWasMoved) {
  const Parallel parallel(1);
  Remarks remarks;
  for (const bool as_start : {true, false}) {
    Track track{FrontendConfig()};
    const auto add = [&](Track& to, int i) {
      return to.process(stamped(room_scan(i), parallel), parallel, remarks, as_start)
          .odometry.odom_from_sensor;
    };
    for (int i = 0; i < 8; ++i) add(track, i);
    Track moved = track;
    const Pose by(so3_exp({0.02, -0.01, 0.4}), {7.0, -3.0, 0.5});
    moved.move(by);
    for (int i = 8; i < 14; ++i) {
      const Pose expected = by * add(track, i);
      const Pose pose = add(moved, i);
      EXPECT_LT((pose.translation - expected.translation).norm(), 0.02) << "scan " << i;
      EXPECT_LT(rotation_angle(pose.rotation.conjugate() * expected.rotation), 0.002) << "scan " << i;
    }
  }
}

TEST(Track, ALimitOfIterationsHoldsUntilItIsLifted) {
  const Parallel parallel(1);
  Remarks remarks;
  Track free{FrontendConfig()};
  for (int i = 0; i < 4; ++i) free.process(stamped(room_scan(i), parallel), parallel, remarks, false);
  Track limited = free, lifted = free;
  limited.limit_iterations(1);
  lifted.limit_iterations(1);
  lifted.lift_limit();
  const StampedCloud next = stamped(room_scan(6), parallel);  // two scans are missing before it
  const Pose pose = free.process(next, parallel, remarks, false).odometry.odom_from_sensor;
  ASSERT_GT(free.last_registration().iterations, 1);
  limited.process(next, parallel, remarks, true);  // as in a search: nothing is refined
  EXPECT_EQ(limited.last_registration().iterations, 1);
  const Pose same = lifted.process(next, parallel, remarks, false).odometry.odom_from_sensor;
  EXPECT_EQ(same.translation, pose.translation);
  limited.limit_iterations(1000);  // more than the configuration allows: no more than that
  limited.process(stamped(room_scan(0), parallel), parallel, remarks, true);
  EXPECT_LE(limited.last_registration().iterations, FrontendConfig().max_iterations);
}

// Through the front-end: what it revises is what the submap holds, and the present does not jump.
TEST(Frontend, RevisesAStartThatItMissed) {
  Frontend frontend{FrontendConfig()}, two_threads{FrontendConfig(), 2};
  std::vector<OdometryResult> said;
  std::size_t revised = 0;
  for (int i = 0; i < kScans + 4; ++i) {
    const FrontendOutput out = frontend.process(bridge_scan(i));
    const FrontendOutput same = two_threads.process(bridge_scan(i));
    EXPECT_TRUE(test::same_bits(out.odometry.odom_from_sensor, same.odometry.odom_from_sensor));
    if (i > 0) {
      const Pose step = said.back().odom_from_sensor.inverse() * out.odometry.odom_from_sensor;
      EXPECT_LT(step.translation.norm(), 2.0 * kStep) << "scan " << i;
    }
    for (const OdometryResult& r : out.revised) said[static_cast<std::size_t>(r.sequence)] = r;
    revised += out.revised.size();
    said.push_back(out.odometry);
    if (out.finished_submap) {
      const Submap& submap = *out.finished_submap;
      ASSERT_GE(submap.scans.size(), std::size_t{kScans});
      for (const ScanPose& s : submap.scans) {
        const Pose pose = submap.odom_from_submap * s.submap_from_sensor;
        EXPECT_LT((pose.translation - said[static_cast<std::size_t>(s.sequence)].odom_from_sensor.translation)
                      .norm(),
                  1e-9);
      }
    }
  }
  EXPECT_EQ(revised, std::size_t{kScans - 1});
  EXPECT_EQ(frontend.take_warnings().size(), 2U);  // no times in the sweep; the start
  for (std::size_t i = 1; i < said.size(); ++i) {
    const Pose step = said[i - 1].odom_from_sensor.inverse() * said[i].odom_from_sensor;
    EXPECT_LT((step.translation - Eigen::Vector3d(kStep, 0, 0)).norm(), 0.2) << "scan " << i;
  }
}

// A start at a speed that registration finds by itself, with stamps that are not what they should be: nothing
// may talk it into standing still.
class BrokenClock : public ::testing::TestWithParam<int> {};

TEST_P(BrokenClock, LeavesARightStartAlone) {
  constexpr double kSlower = 1.6;
  Frontend frontend{FrontendConfig()};
  Dice dice(3);
  std::vector<double> at, is;
  for (int i = 0; i < 24; ++i) {
    const double x = kSlower * i;
    Scan scan = bridge_scan(i, x);
    const auto jitter = static_cast<std::int64_t>(dice.uniform(-15'000, 15'000));
    if (GetParam() == 0 && i == 5) scan.utime += 60'000;
    if (GetParam() == 1 && i == 9) scan.utime += 40'000;
    if (GetParam() == 2 && i >= 8) scan.utime += 1'000'000'000;
    if (GetParam() == 3) scan.utime += jitter;
    const FrontendOutput out = frontend.process(scan);
    for (const OdometryResult& r : out.revised) {
      is[static_cast<std::size_t>(r.sequence)] = r.odom_from_sensor.translation.x();
    }
    at.push_back(x);
    is.push_back(out.odometry.odom_from_sensor.translation.x());
  }
  EXPECT_NEAR(is.back() - is.front(), at.back() - at.front(), 2.0);
  for (std::size_t i = 18; i < at.size(); ++i) EXPECT_NEAR(is[i] - is[i - 1], kSlower, 0.2) << "scan " << i;
}

INSTANTIATE_TEST_SUITE_P(Clocks, BrokenClock, ::testing::Range(0, 4));

// A scan without points among the first ones belongs to the session like any other, and so do those before a
// loss; a front-end that takes up the session at the loss does what this one does.
// Standing, then after 5 s somewhere else, `step` m a scan. Returns how many poses were revised.
std::size_t drive_on_after_a_loss(double step) {
  Frontend frontend{FrontendConfig()}, resumed{FrontendConfig(), 2};
  bool lost = false;
  std::size_t revised = 0;
  std::vector<std::int64_t> sequences;
  const auto collect = [&](const Submap& submap) {
    for (const ScanPose& s : submap.scans) sequences.push_back(s.sequence);
  };
  constexpr int kLoss = 25, kEnd = kLoss + kScans + 4;
  for (int i = 0; i < kEnd; ++i) {
    Scan scan = i < kLoss ? room_scan(0) : bridge_scan(i, step * (i - kLoss));
    scan.sequence = i;
    scan.utime = 1'000'000 + 100'000 * i + (i < kLoss ? 0 : 5'000'000);
    if (i == 1 || i == 12 || i == kLoss + 3) scan.x = scan.y = scan.z = {};
    const FrontendOutput out = frontend.process(scan);
    if (lost) {
      const FrontendOutput same = resumed.process(scan);
      EXPECT_TRUE(test::same_bits(out.odometry.odom_from_sensor, same.odometry.odom_from_sensor)) << i;
      EXPECT_EQ(out.revised.size(), same.revised.size());
      for (std::size_t k = 0; k < std::min(out.revised.size(), same.revised.size()); ++k) {
        EXPECT_TRUE(test::same_bits(out.revised[k].odom_from_sensor, same.revised[k].odom_from_sensor));
      }
      EXPECT_EQ(out.finished_submap.has_value(), same.finished_submap.has_value());
    }
    revised += out.revised.size();
    if (out.finished_submap) collect(*out.finished_submap);
    if (i == kLoss) {
      EXPECT_TRUE(out.finished_submap.has_value());
      resumed.restore_state(frontend.save_state());
      lost = true;
    }
  }
  if (const auto last = frontend.finish()) collect(*last);
  EXPECT_EQ(sequences.size(), static_cast<std::size_t>(kEnd));
  for (std::size_t i = 0; i < sequences.size(); ++i) EXPECT_EQ(sequences[i], static_cast<std::int64_t>(i));
  return revised;
}

TEST(StartSearch, EmptyScansAndALossLeaveNothingOut) {
  // Which speeds the track that is followed misses depends on the last digits of how it was compiled.
  std::size_t revised = 0;
  for (const double share : {1.0, 1.2, 0.85}) {
    revised += drive_on_after_a_loss(share * kStep);
    if (revised > 0) break;
  }
  EXPECT_GT(revised, 0U) << "no start was searched: the test is void";
}

}  // namespace
}  // namespace hp2
