#include "frontend/odometry/odometry_covariance.hpp"

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

namespace hp2 {
namespace {

Vector6d twist(double x, double y, double yaw) {
  Vector6d t;
  t << x, y, 0, 0, 0, yaw;
  return t;
}

IcpResult registered(double rms_m) {
  IcpResult icp;
  icp.information = 1e5 * Matrix6d::Identity();
  icp.information(0, 0) = 1e3;  // weak along the map's x
  icp.rms_m = rms_m;
  return icp;
}

TEST(RegistrationCovariance, GrowsWithTheResidualsAndWhereTheScanSaysLittle) {
  const Matrix6d small = registration_covariance(registered(0.05), 0.5);
  const Matrix6d large = registration_covariance(registered(0.1), 0.5);
  EXPECT_GT(small(0, 0), 10.0 * small(1, 1));
  EXPECT_GT(large(0, 0), 3.5 * small(0, 0));
  // The scale that the weights were taken with cancels out.
  IcpResult icp = registered(0.05);
  icp.information /= 4.0;
  EXPECT_NEAR(registration_covariance(icp, 1.0)(0, 0), small(0, 0), 1e-6 * small(0, 0));
}

TEST(RegistrationCovariance, IsTurnedIntoTheSensorsFrame) {
  IcpResult icp = registered(0.05);
  icp.map_from_source.rotation = so3_exp(Eigen::Vector3d(0, 0, M_PI / 2));
  const Matrix6d covariance = registration_covariance(icp, 0.5);
  EXPECT_GT(covariance(1, 1), 10.0 * covariance(0, 0));  // the map's x is the sensor's -y
}

TEST(DeskewCovariance, OfAnEvenMotionIsNothing) {
  MotionModel motion;
  Pose pose;
  for (int i = 0; i < 6; ++i) {
    pose = pose * se3_exp((i == 3 ? 2.0 : 1.0) * twist(1.0, 0.0, 0.05));
    motion.add(pose, 100000LL * (i < 3 ? i + 1 : i + 2), {});  // one scan was dropped
  }
  EXPECT_LT(deskew_covariance(motion.unevenness(100000)).norm(), 1e-18);
}

TEST(DeskewCovariance, CoversTheChangeOfMotionMostlyAlongIt) {
  MotionModel motion;
  Pose pose;
  motion.add(pose, 100000, {});
  for (int i = 0; i < 4; ++i) motion.add(pose = pose * se3_exp(twist(1.0, 0, 0)), 100000LL * (i + 2), {});
  motion.add(pose = pose * se3_exp(twist(0.9, 0, 0)), 600000, {});
  const Unevenness uneven = motion.unevenness(50000);  // of a sweep that lasts half the interval
  EXPECT_NEAR(uneven.change[0], -0.05, 1e-9);
  EXPECT_NEAR(uneven.jerk[0], -0.05, 1e-9);
  const Matrix6d covariance = deskew_covariance(uneven);
  EXPECT_GT(covariance(0, 0), 10.0 * covariance(1, 1));
  EXPECT_GT(covariance(1, 1), 0.0);
  EXPECT_GE(Eigen::SelfAdjointEigenSolver<Matrix6d>(covariance).eigenvalues()[0], -1e-12);
  // Braking on evenly: the change stays, its own change is gone.
  motion.add(pose * se3_exp(twist(0.8, 0, 0)), 700000, {});
  EXPECT_LT(motion.unevenness(50000).jerk.norm(), 1e-9);
}

TEST(DeskewCovariance, OfAMotionThatNothingForetoldIsAsLargeAsTheMotion) {
  MotionModel motion;
  motion.add(Pose(), 100000, {});
  motion.add(se3_exp(twist(2.0, 0, 0)), 200000, {});
  EXPECT_NEAR(motion.unevenness(100000).change[0], 2.0, 1e-9);
  EXPECT_EQ(motion.unevenness(100000).jerk.norm(), 0.0);
}

}  // namespace
}  // namespace hp2
