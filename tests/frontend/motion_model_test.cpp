// Velocities from poses and time stamps: the motion in a sweep, dropped scans included.
#include "frontend/odometry/motion_model.hpp"

#include <gtest/gtest.h>

namespace hp2 {
namespace {

constexpr std::int64_t kSweep = 100'000;  // [us]

// Along x, at 10 m/s at first, with 4 m/s^2.
Pose accelerating(std::int64_t utime) {
  const double t = 1e-6 * static_cast<double>(utime);
  Pose p;
  p.translation.x() = 10.0 * t + 2.0 * t * t;
  return p;
}

double in_sweep(std::int64_t end) {
  return accelerating(end).translation.x() - accelerating(end - kSweep).translation.x();
}

TEST(MotionModel, PredictionsErrByTheStretchTimesWhatTheyDoFromScanToScan) {
  MotionModel model;
  for (int i = 0; i < 5; ++i) model.add(accelerating(i * kSweep), i * kSweep, {});
  const auto error = [&](std::int64_t t) {
    return (accelerating(t).translation - model.predict(t).translation).norm();
  };
  const double usual = error(5 * kSweep);
  EXPECT_DOUBLE_EQ(model.stretch(5 * kSweep), 1.0);
  for (const int dropped : {1, 2, 3}) {
    const std::int64_t now = (5 + dropped) * kSweep;
    EXPECT_NEAR(error(now), model.stretch(now) * usual, 1e-9) << dropped;
  }
  EXPECT_GE(model.stretch(4 * kSweep + 1), 0.25);  // stamps that jump are no reason for a scale of nothing
}

TEST(MotionModel, MotionInASweepIsThatFromPoseToPose) {
  MotionModel model;
  for (int i = 0; i < 5; ++i) model.add(accelerating(i * kSweep), i * kSweep, {});
  const std::int64_t now = 5 * kSweep;
  EXPECT_NEAR(model.sweep_twist(kSweep, accelerating(now), now)[0], in_sweep(now), 1e-9);
}

TEST(MotionModel, MotionInTheSweepAfterDroppedScansKnowsTheAcceleration) {
  for (const int dropped : {1, 2, 3}) {
    MotionModel model;
    for (int i = 0; i < 5; ++i) model.add(accelerating(i * kSweep), i * kSweep, {});
    const std::int64_t now = (5 + dropped) * kSweep;
    const Pose pose = accelerating(now);
    const double mean = (pose.translation - model.last_pose().translation).x() / (1 + dropped);
    EXPECT_NEAR(model.sweep_twist(kSweep, pose, now)[0], in_sweep(now), 0.2 * std::abs(mean - in_sweep(now)))
        << dropped << " dropped";
  }
}

// A driver that hands over scans in batches stamps one a millisecond after the other.
TEST(MotionModel, AnIntervalOfHardlyAnythingIsNoMeasureOfUnevenness) {
  MotionModel model;
  const auto at = [](int i) {
    Pose pose;
    pose.translation.x() = i;  // 1 m a scan
    return pose;
  };
  std::int64_t utime = 0;
  for (int i = 0; i < 5; ++i) model.add(at(i), utime += kSweep, {});
  EXPECT_NEAR(model.unevenness(kSweep).change.norm(), 0.0, 1e-9);
  model.add(at(5), utime += kSweep / 100, {});
  EXPECT_LT(model.unevenness(kSweep).change.norm(), 3.5);
  model.add(at(6), utime += 2 * kSweep - kSweep / 100, {});
  EXPECT_LT(model.unevenness(kSweep).change.norm(), 3.5);
  EXPECT_LT(model.unevenness(kSweep).jerk.norm(), 7.0);
}

TEST(MotionModel, ASensorWithAStillClockIsPredictedAsIfScansCameEvenly) {
  MotionModel model;
  for (int i = 0; i < 5; ++i) model.add(accelerating(i * kSweep), i * kSweep, {});
  const double step = model.predict(5 * kSweep).translation.x() - model.last_pose().translation.x();
  EXPECT_GT(step, 0.9);
  EXPECT_NEAR(model.predict(4 * kSweep).translation.x() - model.last_pose().translation.x(), step, 1e-9);
}

}  // namespace
}  // namespace hp2
