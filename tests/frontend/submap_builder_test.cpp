// Submaps: where they are cut, what they hold, that nothing is lost between them.
#include "frontend/odometry/submap_builder.hpp"

#include <array>
#include <cmath>
#include <set>
#include <utility>

#include <gtest/gtest.h>

#include "common/registration/submap_normals.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using test::Cloud;
using test::Dice;

struct Drive {
  std::vector<Pose> poses;
  std::vector<Submap> submaps;
};

constexpr double kLength = 5.0, kVoxel = 0.5;

Pose ahead(double x) { return {Eigen::Quaterniond::Identity(), {x, 0, 0}}; }

// 60 scans along a bend, 0.4 m apart; every seventh scan of the stream is missing.
Drive drive(SubmapBuilder& builder) {
  Dice dice(1);
  Drive out;
  std::int64_t sequence = 0;
  for (int i = 0; i < 60; ++i) {
    const std::int64_t skipped = i > 0 && i % 7 == 0 ? 1 : 0;
    sequence += i > 0 ? 1 + skipped : 0;
    const double a = 0.02 * i;
    const Pose pose(so3_exp({0, 0, a}), {20.0 * std::sin(a), 20.0 * (1.0 - std::cos(a)), 0.0});
    out.poses.push_back(pose);
    Cloud cloud;
    for (int k = 0; k < 300; ++k) cloud.push_back(dice.vector(10.0).cast<float>());
    ScanPose scan;
    scan.sequence = sequence;
    auto done = builder.add(cloud, pose, scan, skipped, kLength);
    if (done) out.submaps.push_back(std::move(*done));
  }
  if (auto done = builder.finish()) out.submaps.push_back(std::move(*done));
  return out;
}

TEST(SubmapBuilder, ScansThatAreMovedTakeTheirPointsAlong) {
  SubmapBuilder builder(kVoxel), right(kVoxel);
  Dice dice(2);
  std::vector<Pose> truth;
  const Pose elsewhere(so3_exp({0, 0, 0.3}), {5.0, -2.0, 1.0});
  for (int i = 0; i < 6; ++i) {
    const Pose pose = elsewhere * Pose(so3_exp({0, 0, 0.1 * i}), {0.5 * i, 0, 0});
    const double wrong_m = i < 3 ? 2.0 - i : 0.0;
    truth.push_back(pose);
    const Cloud cloud{dice.vector(100.0).cast<float>(), dice.vector(100.0).cast<float>()};
    ScanPose scan;
    scan.sequence = i;
    ASSERT_FALSE(builder.add(cloud, pose * ahead(wrong_m), scan, 0, 100.0).has_value());
    ASSERT_FALSE(right.add(cloud, pose, scan, 0, 100.0).has_value());
  }
  builder.move_scans(truth);
  right.move_scans(truth);  // which begins at the first scan then
  EXPECT_LT((builder.odom_from_submap().translation - truth[0].translation).norm(), 1e-9);
  const Submap moved = *builder.finish(), expected = *right.finish();
  EXPECT_LT(moved.scans[0].submap_from_sensor.translation.norm(), 1e-9);
  ASSERT_EQ(moved.points.size(), std::size_t{12});
  for (std::size_t k = 0; k < moved.points.size(); ++k) {
    const auto& scan = moved.scans[static_cast<std::size_t>(moved.scan_indices[k])];
    const Pose seen = moved.odom_from_submap * scan.submap_from_sensor;
    EXPECT_LT((seen.translation - truth[static_cast<std::size_t>(scan.sequence)].translation).norm(), 1e-9);
    EXPECT_LT((moved.points[k] - expected.points[k]).norm(), 1e-4F);
  }
}

TEST(SubmapBuilder, ThereIsOnePointAVoxelAndTheWayIsThatOfTheScansAfterTheyWereMoved) {
  SubmapBuilder builder(kVoxel);
  for (int i = 0; i < 3; ++i) {
    ScanPose scan;
    builder.add({Eigen::Vector3f(0.1F, 0.1F, 0.1F)}, ahead(1.0 * i), scan, 0, 100.0);
  }
  builder.move_scans({ahead(1.5), ahead(1.6), ahead(2.0)});
  const Submap moved = *builder.finish();
  EXPECT_EQ(moved.points.size(), 2U);  // two of them see the same now
  EXPECT_EQ(moved.scan_indices, (std::vector<std::int32_t>{0, 2}));
  EXPECT_NEAR(moved.travelled_m, 0.5, 1e-9);
  EXPECT_NEAR(moved.odom_from_submap.translation.x(), 1.5, 1e-12);
}

TEST(SubmapBuilder, CutsAtItsLengthAndLosesNothing) {
  SubmapBuilder builder(kVoxel);
  EXPECT_TRUE(builder.empty());
  const Drive d = drive(builder);
  EXPECT_FALSE(builder.finish().has_value());
  ASSERT_GE(d.submaps.size(), 4U);
  double travelled = 0.0;
  std::int64_t skipped = 0;
  std::size_t scan = 0;
  Pose last;
  for (std::size_t k = 0; k < d.submaps.size(); ++k) {
    const Submap& m = d.submaps[k];
    EXPECT_EQ(m.id, static_cast<std::int64_t>(k));
    EXPECT_LT((m.odom_from_submap.translation - last.translation).norm(), 1e-12);
    EXPECT_LT(rotation_angle(m.odom_from_submap.rotation.conjugate() * last.rotation), 1e-12);
    if (k + 1 < d.submaps.size()) {
      EXPECT_GE(m.travelled_m, kLength);
      EXPECT_LT(m.travelled_m, kLength + 0.5);  // one scan's step at most too long
    }
    ASSERT_FALSE(m.scans.empty());
    for (const ScanPose& s : m.scans) {
      ASSERT_LT(scan, d.poses.size());
      const Pose odom_from_sensor = m.odom_from_submap * s.submap_from_sensor;
      EXPECT_LT((odom_from_sensor.translation - d.poses[scan].translation).norm(), 1e-9);
      EXPECT_LT(rotation_angle(odom_from_sensor.rotation.conjugate() * d.poses[scan].rotation), 1e-7);
      EXPECT_EQ(s.sequence, static_cast<std::int64_t>(scan + scan / 7));  // each once, in order
      ++scan;
    }
    last = d.poses[scan - 1];
    travelled += m.travelled_m;
    skipped += m.scans_skipped;
  }
  EXPECT_EQ(scan, d.poses.size());
  EXPECT_EQ(skipped, 8);
  double length = 0.0;
  for (std::size_t i = 1; i < d.poses.size(); ++i) {
    length += (d.poses[i].translation - d.poses[i - 1].translation).norm();
  }
  EXPECT_NEAR(travelled, length, 1e-9);
}

TEST(SubmapBuilder, OnePointAVoxelWithItsScan) {
  SubmapBuilder builder(kVoxel);
  for (const Submap& m : drive(builder).submaps) {
    ASSERT_EQ(m.points.size(), m.scan_indices.size());
    std::set<std::array<int, 3>> voxels;
    for (std::size_t i = 0; i < m.points.size(); ++i) {
      const Eigen::Vector3f v = (m.points[i] / static_cast<float>(kVoxel)).array().floor();
      EXPECT_TRUE(
          voxels.insert({static_cast<int>(v.x()), static_cast<int>(v.y()), static_cast<int>(v.z())}).second);
      ASSERT_GE(m.scan_indices[i], 0);
      ASSERT_LT(m.scan_indices[i], static_cast<std::int32_t>(m.scans.size()));
      // Seen by that scan: within the cube that the scan's points were drawn from.
      const Pose& sensor = m.scans[static_cast<std::size_t>(m.scan_indices[i])].submap_from_sensor;
      const Eigen::Vector3d p = sensor.inverse() * m.points[i].cast<double>();
      EXPECT_LT(p.cwiseAbs().maxCoeff(), 10.0 + 1e-4);
    }
    EXPECT_GT(m.points.size(), 300U);
  }
}

TEST(SubmapBuilder, StandingStillIsOneSubmap) {
  SubmapBuilder builder(kVoxel);
  for (int i = 0; i < 100; ++i) {
    ScanPose scan;
    EXPECT_FALSE(builder.add({{1.0F, 2.0F, 3.0F}}, Pose(), scan, 0, kLength).has_value());
  }
  const auto m = builder.finish();
  ASSERT_TRUE(m.has_value());
  EXPECT_EQ(m->scans.size(), 100U);
  EXPECT_EQ(m->points.size(), 1U);
  EXPECT_EQ(m->travelled_m, 0.0);
}

// Scans 0.4 m apart; at those in `lost` tracking is lost, and the guess leads 40 m on.
std::vector<Submap> drive_with_losses(const std::set<int>& lost, int n = 60) {
  SubmapBuilder builder(kVoxel);
  std::vector<Submap> submaps;
  Pose pose;
  for (int i = 0; i < n; ++i) {
    ScanPose scan;
    scan.sequence = i;
    scan.state = lost.count(i) > 0 ? TrackingState::kLost : TrackingState::kTracking;
    const bool jump = lost.count(i) > 0 && lost.count(i - 1) == 0;
    pose = pose * Pose({1, 0, 0, 0}, {jump ? 40.0 : 0.4, 0, 0});
    auto done = builder.add({{1.0F, 2.0F, 3.0F}}, pose, scan, 0, kLength);
    if (done) submaps.push_back(std::move(*done));
  }
  if (auto done = builder.finish()) submaps.push_back(std::move(*done));
  return submaps;
}

TEST(SubmapBuilder, EndsWhereTrackingIsLostAndTheJumpIsNoWay) {
  // Without a loss a submap has 13 scans; the second one loses tracking in its eleventh.
  const auto submaps = drive_with_losses({24});
  ASSERT_GE(submaps.size(), 5U);
  EXPECT_EQ(submaps[0].scans.back().sequence, 13);  // the session's first scan led nowhere
  EXPECT_EQ(submaps[1].scans.back().sequence, 24);  // at the loss, which is the next keypose
  EXPECT_LT(submaps[1].travelled_m, kLength);
  EXPECT_EQ(submaps[2].scans.front().sequence, 25);
  EXPECT_LT((submaps[2].odom_from_submap.translation -
             (submaps[1].odom_from_submap * submaps[1].scans.back().submap_from_sensor).translation)
                .norm(),
            1e-9);
  EXPECT_GE(submaps[2].travelled_m, kLength);  // a whole one: the jump was not counted for it either
  for (const Submap& m : submaps) EXPECT_LT(m.travelled_m, kLength + 0.5);
}

TEST(SubmapBuilder, ALossRightAfterACutMakesNoSubmapOfOneScan) {
  auto submaps = drive_with_losses({14, 28});
  submaps.pop_back();  // ends with the drive
  EXPECT_GE(submaps.size(), 3U);
  for (const Submap& m : submaps) EXPECT_GE(m.scans.size(), 13U);
  // Nor does tracking that comes and goes.
  std::set<int> every_other;
  for (int i = 1; i < 200; i += 2) every_other.insert(i);
  submaps = drive_with_losses(every_other, 200);
  submaps.pop_back();
  EXPECT_GE(submaps.size(), 10U);
  for (const Submap& m : submaps) EXPECT_GE(m.scans.size(), 10U);
}

TEST(EstimateNormals, OfAFloorAndOfScatter) {
  Submap m;
  Dice dice(2);
  test::add_patch(m.points, dice, 3000, {-8, -8, 0.3}, {16, 0, 0}, {0, 16, 0});
  const std::size_t floor = m.points.size();
  for (int i = 0; i < 3000; ++i)
    m.points.push_back((dice.vector(3.0) + Eigen::Vector3d(0, 0, 10)).cast<float>());
  m.points.emplace_back(100.0F, 100.0F, 100.0F);  // alone
  estimate_normals(m);
  ASSERT_EQ(m.normals.size(), m.points.size());
  std::size_t up = 0, zero = 0;
  for (std::size_t i = 0; i < m.points.size(); ++i) {
    const float length = m.normals[i].norm();
    EXPECT_TRUE(length == 0.0F || std::abs(length - 1.0F) < 1e-4F);
    if (i < floor) {
      up += std::abs(m.normals[i].z()) > 0.999F ? 1U : 0U;
    } else {
      zero += length == 0.0F ? 1U : 0U;
    }
  }
  EXPECT_GT(up, floor * 98 / 100);
  EXPECT_GT(zero, std::size_t{3000} * 7 / 10);
  EXPECT_EQ(m.normals.back(), Eigen::Vector3f::Zero());
}

}  // namespace
}  // namespace hp2
