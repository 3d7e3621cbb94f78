// Moments, eigenvalues, planarity score and threshold against known answers.
#include "common/registration/planarity.hpp"

#include <cmath>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using test::Dice;

TEST(AdaptiveThreshold, KnownValuesAndClamps) {
  EXPECT_DOUBLE_EQ(adaptive_threshold(27, 0.2, 27, 0.05, 0.3), 0.2);
  EXPECT_DOUBLE_EQ(adaptive_threshold(54, 0.2, 27, 0.05, 0.3), 0.1);
  EXPECT_DOUBLE_EQ(adaptive_threshold(20, 0.2, 30, 0.05, 0.5), 0.3);
  EXPECT_DOUBLE_EQ(adaptive_threshold(1000, 0.2, 27, 0.05, 0.3), 0.05);
  EXPECT_DOUBLE_EQ(adaptive_threshold(1, 0.2, 27, 0.05, 0.3), 0.3);
}

void expect_eigen(const Matrix3d& m) {
  const SmallestEigen e = smallest_eigenvector(m);
  const Eigen::SelfAdjointEigenSolver<Matrix3d> reference(m);
  const double scale = m.norm() + 1e-300;
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(e.values[i] / scale, reference.eigenvalues()[2 - i] / scale, 1e-7) << m;
  }
  EXPECT_NEAR(e.normal.norm(), 1.0, 1e-9) << m;
  // Whatever vector of the eigenspace was taken, m maps it to l3 times itself.
  EXPECT_LT((m * e.normal - reference.eigenvalues()[0] * e.normal).norm() / scale, 1e-6) << m;
}

TEST(SmallestEigenvector, AgreesWithEigen) {
  Dice dice(1);
  for (int i = 0; i < 2000; ++i) {
    Matrix3d a;
    for (int k = 0; k < 3; ++k) a.col(k) = dice.vector(1.0);
    expect_eigen(a * a.transpose() * std::pow(10.0, dice.uniform(-8, 8)));
  }
}

TEST(SmallestEigenvector, HoldsOnDegenerateMatrices) {
  expect_eigen(Matrix3d::Zero());
  expect_eigen(Matrix3d::Identity());
  expect_eigen(1e-12 * Matrix3d::Identity());
  Dice dice(2);
  for (int i = 0; i < 300; ++i) {
    const Matrix3d r = so3_exp(dice.vector(3.0)).toRotationMatrix();
    const double s = std::pow(10.0, dice.uniform(-6, 3));
    // Line, plane, exact plane of two equal values, two equal smallest values, nearly equal ones.
    for (const Vector3d& l :
         {Vector3d(1, 0, 0), Vector3d(1, 0.5, 0), Vector3d(1, 1, 0), Vector3d(1, 0.2, 0.2), Vector3d(1, 1, 1),
          Vector3d(1, 0.3, 0.3 - 1e-9), Vector3d(1, 1 - 1e-10, 1e-10)}) {
      const Matrix3d m = s * r * l.asDiagonal() * r.transpose();
      expect_eigen(0.5 * (m + m.transpose()));
    }
  }
}

Planarity shape_of(const std::vector<Vector3d>& points) {
  Moments m;
  for (const auto& p : points) m.add(p);
  return analyse(m);
}

TEST(Planarity, PlaneLineAndBall) {
  Dice dice(3);
  const Matrix3d r = so3_exp(dice.vector(2.0)).toRotationMatrix();
  std::vector<Vector3d> plane, line, cube;
  for (int i = 0; i < 400; ++i) {
    plane.push_back(r * Vector3d(dice.uniform(-1, 1), dice.uniform(-1, 1), 0.3));
    line.push_back(r * Vector3d(dice.uniform(-1, 1), 0.2, 0.3));
  }
  for (int i = 0; i < 8; ++i) cube.push_back(r * Vector3d(i & 1, (i >> 1) & 1, (i >> 2) & 1));
  const Planarity p = shape_of(plane), l = shape_of(line), b = shape_of(cube);
  EXPECT_EQ(p.n, 400.0F);
  EXPECT_NEAR(p.score, 0.0, 1e-6);
  EXPECT_NEAR(std::abs(p.normal.cast<double>().dot(r.col(2))), 1.0, 1e-6);
  EXPECT_NEAR(l.score, 0.0, 1e-6);
  EXPECT_NEAR(std::abs(l.normal.cast<double>().dot(r.col(0))), 0.0, 1e-3);
  EXPECT_NEAR(b.score, 1.0 / 3.0, 1e-6);
  EXPECT_NEAR(std::abs(l.line.cast<double>().dot(r.col(0))), 1.0, 1e-6);
  EXPECT_EQ(p.line, Eigen::Vector3f::Zero());
  EXPECT_EQ(b.line, Eigen::Vector3f::Zero());
}

TEST(Planarity, ABandIsALineWhileItIsNarrow) {
  const auto band = [](double half_width) {
    return shape_of({{1, half_width, 0}, {-1, half_width, 0}, {1, -half_width, 0}, {-1, -half_width, 0}});
  };
  EXPECT_NEAR(std::abs(band(0.3).line.x()), 1.0F, 1e-6F);
  EXPECT_EQ(band(0.33).line, Eigen::Vector3f::Zero());  // l2 / l1 = 0.11
}

TEST(Planarity, KnownScore) {
  // Points at +-a on each axis: covariance diag(a^2) / 3.
  const Planarity s = shape_of({{2, 0, 0}, {-2, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 0.5}, {0, 0, -0.5}});
  EXPECT_NEAR(s.score, 0.25 / 5.25, 1e-6);
}

TEST(Planarity, TooFewOrCoincidentPointsAreNotPlanar) {
  EXPECT_EQ(shape_of({}).score, 1.0F);
  EXPECT_EQ(shape_of({{1, 2, 3}, {2, 2, 3}}).score, 1.0F);
  const Planarity same = shape_of({{0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}, {0.5, 0.5, 0.5}});
  EXPECT_EQ(same.score, 1.0F);
  EXPECT_TRUE(same.normal.allFinite());
}

TEST(Moments, ShiftedSumsAddUp) {
  Dice dice(4);
  const Vector3d shift = dice.vector(2.0);
  Moments all, other;
  for (int i = 0; i < 50; ++i) {
    const Vector3d p = dice.vector(1.0);
    other.add(p);
    all.add(p + shift);
  }
  Moments moved;
  moved.add_shifted(other, shift);
  EXPECT_EQ(moved.n, all.n);
  EXPECT_LT((moved.mean() - all.mean()).norm(), 1e-12);
  EXPECT_LT((moved.covariance() - all.covariance()).norm(), 1e-12);
  EXPECT_LT((moved.covariance() - other.covariance()).norm(), 1e-12);
  EXPECT_EQ(Moments().covariance(), Matrix3d::Zero());
}

}  // namespace
}  // namespace hp2
