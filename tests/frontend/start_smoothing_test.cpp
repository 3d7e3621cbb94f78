// The first scans of a session, smoothed with the backward pass.
#include "frontend/odometry/start_smoothing.hpp"

#include <gtest/gtest.h>

#include "tests/frontend/tiny_drive.hpp"

namespace hp2 {
namespace {

using test::tiny_drive;

constexpr std::size_t kScans = 16;  // of the initialisation

std::vector<StampedCloud> start(std::size_t n, bool with_times = true) {
  const FrontendConfig c;
  Preprocessor preprocessor({c.min_range_m, c.max_range_m, c.map_point_voxel_m, c.source_voxel_m});
  const Parallel parallel(1);
  std::vector<StampedCloud> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Scan& scan = tiny_drive().scans[i];
    preprocessor.run(scan, with_times, parallel, out[i].cloud);
    out[i].sequence = scan.sequence;
    out[i].utime = scan.utime_end();
    out[i].duration_us = with_times ? scan.duration_us : 0;
  }
  return out;
}

std::vector<Pose> truth(std::size_t n) {
  return {tiny_drive().truth.begin(), tiny_drive().truth.begin() + static_cast<std::ptrdiff_t>(n)};
}

std::vector<Pose> smoothed(const std::vector<StampedCloud>& scans, const std::vector<Pose>& poses) {
  return smoothed_start(FrontendConfig(), scans, poses, Parallel(1));
}

double off_m(const std::vector<Pose>& poses, std::size_t i) {
  return (poses[i].translation - tiny_drive().truth[i].translation).norm();
}

TEST(StartSmoothing, FirstPosesThatWereWrongAreRightWithTheWayBack) {
  std::vector<Pose> poses = truth(kScans);
  const double wrong_m[] = {0.8, 0.3, -0.2};
  for (std::size_t i = 0; i < 3; ++i) poses[i] = poses[i] * Pose(so3_exp({0, 0, 0.03}), {wrong_m[i], 0, 0});
  const std::vector<Pose> out = smoothed(start(kScans), poses);
  ASSERT_EQ(out.size(), kScans);
  EXPECT_LT(off_m(out, 0), 0.03);
  EXPECT_LT(off_m(out, 1), 0.05);
  EXPECT_LT(off_m(out, 2), 0.06);
  for (std::size_t i = 3; i < kScans; ++i) EXPECT_LT(off_m(out, i), 0.03) << i;
  EXPECT_TRUE(test::same_bits(out.back(), poses.back()));
}

TEST(StartSmoothing, AFirstPoseThatWouldMoveTooFarIsLeftAsItIs) {
  std::vector<Pose> poses = truth(kScans);
  poses[0].translation.x() += 6.0;
  EXPECT_TRUE(smoothed(start(kScans), poses).empty());
}

TEST(StartSmoothing, AWayThatTheScansContradictIsLeftAsItIs) {
  std::vector<Pose> poses = truth(kScans);
  for (std::size_t i = 0; i < kScans; ++i) poses[i].translation *= 1.0 + 0.1 * static_cast<double>(i);
  EXPECT_TRUE(smoothed(start(kScans), poses).empty());
}

TEST(StartSmoothing, WhatTellsNothingIsLeftAsItIs) {
  EXPECT_TRUE(smoothed(start(5), truth(5)).empty());                // too few
  EXPECT_TRUE(smoothed(start(kScans), truth(kScans - 1)).empty());  // poses are missing
  for (const std::size_t empty : {std::size_t{0}, std::size_t{7}, kScans - 1}) {
    std::vector<StampedCloud> scans = start(kScans);
    scans[empty].cloud = {};
    EXPECT_TRUE(smoothed(scans, truth(kScans)).empty()) << empty;
  }
  EXPECT_TRUE(smoothed(start(kScans, false), truth(kScans)).empty());  // no times in the sweep
  std::vector<StampedCloud> scans = start(kScans);
  scans[4].utime = scans[3].utime;
  EXPECT_TRUE(smoothed(scans, truth(kScans)).empty());
}

// Through the front-end: all but the newest of the first 16 poses are re-estimated, and are nearer to the
// truth.
TEST(Frontend, SaysItsFirstPosesAgain) {
  Frontend frontend{FrontendConfig()}, two_threads{FrontendConfig(), 2};
  std::vector<Pose> first, again;
  for (std::size_t i = 0; i < tiny_drive().scans.size(); ++i) {
    const FrontendOutput out = frontend.process(tiny_drive().scans[i]);
    const FrontendOutput same = two_threads.process(tiny_drive().scans[i]);
    EXPECT_EQ(out.revised.size(), i + 1 == kScans ? kScans - 1 : 0) << i;
    ASSERT_EQ(out.revised.size(), same.revised.size());
    for (std::size_t k = 0; k < out.revised.size(); ++k) {
      const OdometryResult& r = out.revised[k];
      EXPECT_EQ(r.sequence, static_cast<std::int64_t>(k));
      EXPECT_TRUE(test::same_bits(r.odom_from_sensor, same.revised[k].odom_from_sensor)) << k;
      again[k] = r.odom_from_sensor;
    }
    first.push_back(out.odometry.odom_from_sensor);
    again.push_back(out.odometry.odom_from_sensor);
    if (i + 1 == kScans) break;
  }
  const auto error = [](const std::vector<Pose>& poses) {
    double sum = 0.0;
    for (std::size_t i = 0; i < kScans; ++i) {
      const Pose way = poses.back().inverse() * poses[i];
      const Pose true_way = tiny_drive().truth[kScans - 1].inverse() * tiny_drive().truth[i];
      sum += (way.translation - true_way.translation).norm();
    }
    return sum / kScans;
  };
  EXPECT_LT(error(again), 0.9 * error(first));
}

TEST(Frontend, SaysNothingAgainOfAStartThatIsNotTheSessions) {
  Frontend frontend{FrontendConfig()};
  for (std::size_t i = 0; i < kScans + 6; ++i) {
    Scan scan = tiny_drive().scans[i];
    if (i < 3) scan.x = scan.y = scan.z = scan.time = {};
    EXPECT_TRUE(frontend.process(scan).revised.empty()) << i;
  }
}

}  // namespace
}  // namespace hp2
