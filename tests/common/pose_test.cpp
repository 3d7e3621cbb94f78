#include "common/geometry/pose.hpp"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

Eigen::Matrix4d hat(const Vector6d& x) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Zero();
  m.topLeftCorner<3, 3>() = skew(x.tail<3>());
  m.topRightCorner<3, 1>() = x.head<3>();
  return m;
}

// exp of a matrix by scaling and squaring of its power series: the definition, independent of the closed
// forms.
Eigen::Matrix4d matrix_exp(const Eigen::Matrix4d& a) {
  const Eigen::Matrix4d small = a / 1024.0;
  Eigen::Matrix4d sum = Eigen::Matrix4d::Identity(), term = Eigen::Matrix4d::Identity();
  for (int k = 1; k < 20; ++k) {
    term = term * small / k;
    sum += term;
  }
  for (int i = 0; i < 10; ++i) sum = sum * sum;
  return sum;
}

Vector6d random_twist(std::mt19937& rng, double angle, double length) {
  std::normal_distribution<double> n;
  Eigen::Vector3d axis(n(rng), n(rng), n(rng)), dir(n(rng), n(rng), n(rng));
  Vector6d x;
  x << length * dir.normalized(), angle * axis.normalized();
  return x;
}

TEST(Pose, ExpIsTheMatrixExponentialAndLogItsInverseOverTheWholeRange) {
  std::mt19937 rng(1);
  for (const double angle :
       {0.0, 1e-12, 1e-9, 1e-6, 9.9e-4, 1.1e-3, 0.1, 1.0, 2.0, 3.0, 3.14, M_PI - 1e-6, M_PI - 1e-9}) {
    for (const double length : {0.0, 1e-6, 1.0, 500.0}) {
      const Vector6d x = random_twist(rng, angle, length);
      const Pose pose = se3_exp(x);
      const Eigen::Matrix<double, 3, 4> expected = matrix_exp(hat(x)).topRows<3>();
      EXPECT_LT((pose.matrix() - expected).norm(), 1e-11 * (1.0 + length)) << "angle " << angle;
      EXPECT_LT((se3_log(pose) - x).norm(), 2e-9 * (1.0 + length)) << "angle " << angle;
    }
  }
}

TEST(Pose, LogOfHalfTurnsHasAngleAtMostPi) {
  for (const Eigen::Vector3d& axis :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(1, 2, 3)}) {
    for (const double angle : {M_PI - 1e-12, M_PI, M_PI + 1e-12, 2 * M_PI - 1e-3}) {
      const Eigen::Quaterniond q(Eigen::AngleAxisd(angle, axis.normalized()));
      const Eigen::Vector3d phi = so3_log(q);
      EXPECT_LE(phi.norm(), M_PI + 1e-9);
      EXPECT_LT(so3_exp(phi).angularDistance(q), 1e-7);
    }
  }
}

TEST(Pose, ChainedConstantVelocityPredictionsStayInSO3) {
  std::mt19937 rng(2);
  Pose previous, current = se3_exp(random_twist(rng, 0.2, 1.0));
  for (int i = 0; i < 10000; ++i) {
    const Pose predicted = current * (previous.inverse() * current);
    previous = current;
    current = predicted;
  }
  const Eigen::Matrix3d r = current.rotation.toRotationMatrix();
  EXPECT_LT((r * r.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-14);
  EXPECT_TRUE(current.is_finite());
}

TEST(Pose, AdjointMovesTwistsThroughPoses) {
  std::mt19937 rng(3);
  const Pose t = se3_exp(random_twist(rng, 2.0, 5.0));
  const Vector6d x = random_twist(rng, 0.7, 2.0);
  const Pose left = se3_exp(adjoint(t) * x);
  const Pose right = t * se3_exp(x) * t.inverse();
  EXPECT_LT((left.matrix() - right.matrix()).norm(), 1e-12);
}

TEST(Pose, FromMatrixTakesTheNearestRotation) {
  std::mt19937 rng(4);
  const Pose t = se3_exp(random_twist(rng, 1.3, 5.0));
  Eigen::Matrix<double, 3, 4> m = t.matrix();
  m.leftCols<3>() *= 1.001;
  EXPECT_LT((Pose::from_matrix(m).matrix() - t.matrix()).norm(), 1e-12);
}

TEST(Pose, InterpolateHitsBothEndsAndHalvesTheMotion) {
  std::mt19937 rng(5);
  const Pose a = se3_exp(random_twist(rng, 1.0, 3.0)), b = a * se3_exp(random_twist(rng, 0.8, 2.0));
  EXPECT_LT((interpolate(a, b, 0.0).matrix() - a.matrix()).norm(), 1e-12);
  EXPECT_LT((interpolate(a, b, 1.0).matrix() - b.matrix()).norm(), 1e-12);
  const Pose half = interpolate(a, b, 0.5);
  EXPECT_LT((se3_log(a.inverse() * half) - se3_log(half.inverse() * b)).norm(), 1e-12);
}

}  // namespace
}  // namespace hp2
