// Velocities from registered poses: noise kept out, changes followed, nothing fed back.
#include "frontend/odometry/motion_filter.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "common/error.hpp"
#include "frontend/odometry/motion_model.hpp"

namespace hp2 {
namespace {

constexpr double kInterval = 0.1;  // [s]

Vector6d along(double x, double yaw = 0.0) {
  Vector6d v;
  v << x, 0, 0, 0, 0, yaw;
  return v;
}

// Deviations of `t` [m] and a tenth of it [rad].
Matrix6d deviation(double t) {
  Vector6d d;
  d << t, t, t, 0.1 * t, 0.1 * t, 0.1 * t;
  return d.cwiseAbs2().asDiagonal();
}

TEST(MotionFilter, FollowsAnAccelerationAndATurn) {
  MotionFilter filter;
  Pose pose;
  filter.start(pose, along(10.0));
  double speed = 10.0, turn = 0.0;
  for (int i = 0; i < 20; ++i) {
    const double acceleration = 2.0, turning = 0.5;  // [m/s^2, rad/s^2]
    pose = pose * se3_exp(kInterval *
                          along(speed + 0.5 * kInterval * acceleration, turn + 0.5 * kInterval * turning));
    speed += kInterval * acceleration;
    turn += kInterval * turning;
    filter = filter.measured(pose, deviation(0.005), kInterval);
  }
  // A motion from pose to pose would be behind by 0.1 m/s and 0.025 rad/s.
  EXPECT_NEAR(filter.velocity()[0], speed, 0.03);
  EXPECT_NEAR(filter.velocity()[5], turn, 0.01);
  EXPECT_NEAR(filter.velocity_after(kInterval)[0], speed + 0.2, 0.1);  // it expects the acceleration to end
  EXPECT_LT(filter.surprise(), 1.0);
}

TEST(MotionFilter, ThePosesNoiseHardlyMovesTheVelocity) {
  constexpr double kNoise = 0.02;
  MotionFilter filter;
  Pose pose;
  filter.start(pose, along(10.0));
  double worst = 0.0;
  for (int i = 0; i < 40; ++i) {
    pose = pose * se3_exp(kInterval * along(10.0));
    Pose seen = pose;
    seen.translation.x() += i % 2 == 0 ? kNoise : -kNoise;
    filter = filter.measured(seen, deviation(kNoise), kInterval);
    if (i > 10) worst = std::max(worst, std::abs(filter.velocity()[0] - 10.0));
  }
  EXPECT_LT(worst, 0.6 * 2.0 * kNoise / kInterval);  // that from pose to pose errs by all of it
}

TEST(MotionFilter, AWeakDirectionIsNotHeard) {
  MotionFilter filter;
  filter.start(Pose(), along(10.0));
  Matrix6d covariance = deviation(0.005);
  covariance(0, 0) = 4.0;  // the scan does not tell where along x the sensor is
  Pose seen = se3_exp(kInterval * along(10.0));
  seen.translation += Eigen::Vector3d(0.5, 0.05, 0.0);
  filter = filter.measured(seen, covariance, kInterval);
  EXPECT_NEAR(filter.velocity()[0], 10.0, 0.1);  // that from pose to pose is off by 5
  EXPECT_GT(filter.velocity()[1], 0.2);
}

TEST(MotionFilter, SaysWhenAMotionWasNotToBeExpected) {
  MotionFilter filter;
  Pose pose;
  filter.start(pose, along(10.0));
  for (int i = 0; i < 10; ++i) {
    pose = pose * se3_exp(kInterval * along(10.0));
    filter = filter.measured(pose, deviation(0.005), kInterval);
  }
  EXPECT_LT(filter.surprise(), 0.1);
  pose.rotation = pose.rotation * so3_exp(Eigen::Vector3d(0.0, 0.2, 0.0));
  EXPECT_GT(filter.measured(pose, deviation(0.005), kInterval).surprise(), 10.0);
}

TEST(MotionFilter, GrowsUnsureWhereNothingIsMeasured) {
  MotionFilter known;
  known.start(Pose(), along(10.0));
  MotionFilter guessed = known;
  for (int i = 1; i <= 10; ++i) guessed = guessed.guessed(se3_exp(i * kInterval * along(10.0)), kInterval);
  // So a pose beside the expected one surprises less.
  const Pose beside = se3_exp(along(0.3));
  const Pose one_on = se3_exp(kInterval * along(10.0)), eleven_on = se3_exp(11 * kInterval * along(10.0));
  EXPECT_LT(guessed.measured(eleven_on * beside, deviation(0.05), kInterval).surprise(),
            0.1 * known.measured(one_on * beside, deviation(0.05), kInterval).surprise());
}

TEST(MotionFilter, IsSavedAndReadBackAndChecked) {
  MotionFilter filter;
  filter.start(Pose(), along(10.0, 0.1));
  filter = filter.measured(se3_exp(along(1.01)), deviation(0.01), kInterval);
  std::vector<std::uint8_t> bytes;
  ByteWriter writer(bytes);
  filter.save(writer);
  MotionFilter back;
  ByteReader reader(bytes.data(), bytes.data() + bytes.size(), "a test");
  back.load(reader);
  EXPECT_EQ(reader.left(), 0U);
  const Pose next = se3_exp(along(2.0));
  EXPECT_EQ(back.measured(next, deviation(0.01), kInterval).velocity(),
            filter.measured(next, deviation(0.01), kInterval).velocity());
  const double nonsense = std::nan("");
  std::memcpy(bytes.data() + 7 * sizeof(double), &nonsense, sizeof nonsense);  // the velocity's x
  ByteReader damaged(bytes.data(), bytes.data() + bytes.size(), "a test");
  EXPECT_THROW(back.load(damaged), Error);
}

// Registration puts a sweep's middle where it belongs: a deskewing that is too long by e puts its end e / 2
// too far ahead. Velocities from ends swing: each error comes back with the other sign.
TEST(MotionModel, AnErrorOfDeskewingDiesAwayWithoutSwinging) {
  constexpr std::int64_t kSweep = 100'000;  // [us]
  constexpr double kSpeed = 10.0;
  MotionModel model;
  const auto end = [&](int i, double error) { return se3_exp(along(kSpeed * kInterval * i + 0.5 * error)); };
  for (int i = 0; i < 2; ++i) model.add(end(i, 0.0), i * kSweep, {along(kSpeed * kInterval), kSweep});
  double first = 0.0, last = 0.0;
  for (int i = 2; i < 30; ++i) {
    const std::int64_t now = i * kSweep;
    SweepMotion sweep{model.sweep_twist(kSweep, now), kSweep};
    if (i == 2) sweep.twist[0] += 0.1;  // a disturbance
    for (int pass = 0; pass < 2 && i > 2; ++pass)
      sweep.twist =
          model.sweep_twist(sweep, end(i, sweep.twist[0] - kSpeed * kInterval), deviation(0.005), now);
    const double error = sweep.twist[0] - kSpeed * kInterval;
    const Matrix6d covariance = deviation(0.005);
    model.add_filtered(end(i, error), now, sweep, &covariance);
    (i == 2 ? first : last) = error;
  }
  EXPECT_NEAR(first, 0.1, 1e-9);
  EXPECT_LT(std::abs(last), 1e-3);
}

}  // namespace
}  // namespace hp2
