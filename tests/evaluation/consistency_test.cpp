#include "common/evaluation/consistency.hpp"

#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

// A drive of constant motion, and one whose motions err by draws from each pose's covariance.
struct Drives {
  std::vector<Pose> truth{Pose()}, estimate{Pose()};
  std::vector<Matrix6d> covariances{Matrix6d::Zero()};
};

Drives noisy_drives(std::size_t n) {
  Vector6d motion, deviation;
  motion << 1.0, 0.05, -0.01, 0.002, -0.001, 0.1;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  Drives d;
  while (d.truth.size() < n) {
    // A mixed covariance, tight along some directions and wide along others.
    Matrix6d root = Matrix6d::Zero();
    for (int i = 0; i < 6; ++i) root(i, i) = i < 3 ? 0.01 * (i + 1) : 0.0005 * i;
    root(1, 0) = 0.02;
    root(5, 0) = 0.001;
    for (int i = 0; i < 6; ++i) deviation[i] = normal(random);
    d.truth.push_back(d.truth.back() * se3_exp(motion));
    d.estimate.push_back(d.estimate.back() * se3_exp(motion) * se3_exp(root * deviation));
    d.covariances.emplace_back(root * root.transpose());
  }
  return d;
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

TEST(NormalisedErrors, AverageSixWhereTheCovariancesAreTheErrorsOwn) {
  Drives d = noisy_drives(5000);
  const std::vector<double> errors = normalised_errors_squared(d.truth, d.estimate, d.covariances);
  ASSERT_EQ(errors.size(), 4999U);
  EXPECT_NEAR(mean(errors), 6.0, 0.3);
  for (auto& c : d.covariances) c *= 4.0;
  EXPECT_NEAR(mean(normalised_errors_squared(d.truth, d.estimate, d.covariances)), 1.5, 0.1);
}

TEST(NormalisedErrors, DoNotDependOnWhereEitherTrajectoryBegins) {
  Drives d = noisy_drives(20);
  const std::vector<double> before = normalised_errors_squared(d.truth, d.estimate, d.covariances);
  Vector6d twist;
  twist << 10, -20, 3, 0.3, -1.2, 2.0;
  for (auto& pose : d.truth) pose = se3_exp(twist) * pose;
  const std::vector<double> after = normalised_errors_squared(d.truth, d.estimate, d.covariances);
  for (std::size_t i = 0; i < before.size(); ++i) EXPECT_NEAR(after[i], before[i], 1e-6 * before[i]);
}

TEST(NormalisedErrors, OfAKnownErrorInOneDirection) {
  Vector6d error = Vector6d::Zero(), motion;
  error[1] = 0.02;
  motion << 1, 0, 0, 0, 0, 0.3;
  const std::vector<Pose> truth{Pose(), se3_exp(motion)}, estimate{Pose(), se3_exp(motion) * se3_exp(error)};
  Matrix6d covariance = Matrix6d::Identity();
  covariance(1, 1) = 0.01 * 0.01;  // the current frame's y
  EXPECT_NEAR(normalised_errors_squared(truth, estimate, {covariance, covariance})[0], 4.0, 1e-9);
}

TEST(NormalisedErrors, AreNoNumberForACovarianceThatIsNone) {
  const std::vector<Pose> poses(2);
  EXPECT_TRUE(std::isnan(normalised_errors_squared(poses, poses, {Matrix6d::Zero(), Matrix6d::Zero()})[0]));
  EXPECT_THROW(normalised_errors_squared(poses, poses, {Matrix6d::Zero()}), Error);
}

}  // namespace
}  // namespace hp2
