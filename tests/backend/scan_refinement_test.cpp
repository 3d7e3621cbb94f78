#include "backend/graph/scan_refinement.hpp"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "backend/graph/odometry_noise.hpp"
#include "backend_fixtures.hpp"

namespace hp2 {
namespace {

TEST(ScanRefinement, WithoutACorrectionTheScansStayWhereOdometryPutThem) {
  const Submap m = testing::random_submap(0, {});
  const Pose start = se3_exp((Vector6d() << 10, -3, 1, 0.1, 0.2, 0.9).finished());
  const Pose next = start * m.scans.back().submap_from_sensor;
  const auto poses = refine_scans(m.scans, start, &next);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_LT(se3_log(poses[i].inverse() * start * m.scans[i].submap_from_sensor).norm(), 1e-9);
  }
}

double cost(const std::vector<OdometryStep>& steps, const std::vector<Pose>& poses, const Pose& start) {
  double sum = 0.0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const Pose& previous = i ? poses[i - 1] : start;
    const Vector6d e = se3_log(steps[i].previous_from_current.inverse() * previous.inverse() * poses[i]);
    sum += e.dot(steps[i].covariance.inverse() * e);
  }
  return sum;
}

TEST(ScanRefinement, ReachesTheNextKeyposeAtTheSmallestCost) {
  Submap m = testing::random_submap(0, {}, 10, 30);
  m.scans[12].covariance *= 400.0;  // one bad step must take most of the gap
  const Pose start;
  Vector6d gap;
  gap << 0.4, -0.3, 0.1, 0.01, -0.02, 0.05;
  const Pose next = m.scans.back().submap_from_sensor * se3_exp(gap);
  auto poses = refine_scans(m.scans, start, &next);
  EXPECT_LT(se3_log(poses.back().inverse() * next).norm(), 1e-9);
  const auto steps = odometry_steps(m.scans);
  const double best = cost(steps, poses, start);
  // No pose can be moved in any direction without the cost rising: a minimum.
  for (std::size_t i = 0; i + 1 < poses.size(); i += 5) {
    for (int d = 0; d < 12; ++d) {
      auto moved = poses;
      Vector6d x = Vector6d::Zero();
      x[d % 6] = d < 6 ? 1e-4 : -1e-4;
      moved[i] = moved[i] * se3_exp(x);
      EXPECT_GT(cost(steps, moved, start), best * (1.0 - 1e-9));
    }
  }
}

TEST(OdometryNoise, AccumulatedCovarianceIsThatOfRandomChains) {
  const Submap m = testing::random_submap(0, {}, 10, 20);
  const auto steps = odometry_steps(m.scans);
  const Matrix6d predicted = accumulated_covariance(steps);
  std::mt19937 rng(5);
  std::normal_distribution<double> normal;
  Matrix6d sampled = Matrix6d::Zero();
  const int n = 20000;
  for (int k = 0; k < n; ++k) {
    Pose pose;
    for (const auto& step : steps) {
      const Matrix6d root = step.covariance.llt().matrixL();
      Vector6d x;
      for (int i = 0; i < 6; ++i) x[i] = normal(rng);
      pose = pose * step.previous_from_current * se3_exp(root * x);
    }
    const Vector6d e = se3_log(m.scans.back().submap_from_sensor.inverse() * pose);
    sampled += e * e.transpose() / n;
  }
  EXPECT_LT((sampled - predicted).norm(), 0.05 * predicted.norm());
}

}  // namespace
}  // namespace hp2
