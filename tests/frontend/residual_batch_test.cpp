// Sums of residuals against the Jacobians written out.
#include "common/registration/residual_batch.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using Eigen::Vector3d;
using test::Dice;

// Floats hold seven digits; the sums are of terms of either sign.
constexpr double kDigits = 1e-5;

void expect_close(const Matrix6d& a, const Matrix6d& b, const Vector6d& ga, const Vector6d& gb) {
  EXPECT_LT((a - b).norm(), kDigits * b.norm());
  EXPECT_LT((ga - gb).norm(), kDigits * gb.norm());
}

class ResidualBatchSizes : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Sizes, ResidualBatchSizes, ::testing::Values(1, 3, 4, 7, 8, 100, 255, 256));

TEST_P(ResidualBatchSizes, PlanesGiveTheSumsOfTheirJacobians) {
  Dice dice(static_cast<unsigned>(GetParam()));
  PlaneBatch batch;
  PlaneSums sums;
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double squares = 0.0;
  for (int round = 0; round < 2; ++round) {  // a batch is used again
    for (int i = 0; i < GetParam(); ++i) {
      const Eigen::Vector3f p = dice.vector(50.0).cast<float>(),
                            n = dice.vector(1.0).normalized().cast<float>();
      const auto e = static_cast<float>(dice.uniform(0.0, 0.3)),
                 w = static_cast<float>(dice.uniform(0.1, 2.0));
      batch.add({p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), e, w});
      Vector6d j;
      j << n.cast<double>(), p.cast<double>().cross(n.cast<double>());
      information += w * j * j.transpose();
      gradient += w * e * j;
      squares += static_cast<double>(w) * e * e;
    }
    EXPECT_EQ(batch.size(), static_cast<std::size_t>(GetParam()));
    batch.flush(sums);
    EXPECT_EQ(batch.size(), 0U);
  }
  expect_close(sums.information(), information, sums.gradient(), gradient);
  EXPECT_NEAR(sums.squares, squares, kDigits * squares);
  EXPECT_EQ(sums.count, 2 * GetParam());
}

TEST_P(ResidualBatchSizes, PointsGiveTheSumsOfTheirJacobians) {
  Dice dice(1000 + static_cast<unsigned>(GetParam()));
  PointBatch batch;
  PointSums sums;
  Matrix6d information = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double squares = 0.0;
  for (int i = 0; i < GetParam(); ++i) {
    const Eigen::Vector3f p = dice.vector(50.0).cast<float>(), r = dice.vector(0.5).cast<float>();
    const auto w = static_cast<float>(dice.uniform(0.1, 2.0));
    batch.add({p.x(), p.y(), p.z(), r.x(), r.y(), r.z(), w});
    Eigen::Matrix<double, 3, 6> j;
    j << Eigen::Matrix3d::Identity(), -skew(p.cast<double>());
    information += w * j.transpose() * j;
    gradient += w * j.transpose() * r.cast<double>();
    squares += w * r.cast<double>().squaredNorm();
  }
  batch.flush(sums);
  expect_close(sums.information(), information, sums.gradient(), gradient);
  EXPECT_NEAR(sums.squares, squares, kDigits * squares);
  EXPECT_EQ(sums.count, GetParam());
}

}  // namespace
}  // namespace hp2
