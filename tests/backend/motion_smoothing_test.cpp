// Smoothing: the optimum it claims, noise and motion told apart, and what it must leave alone.
#include "backend/graph/motion_smoothing.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "backend/backend.hpp"
#include "backend_fixtures.hpp"

namespace hp2 {
namespace {

using Curve = std::vector<double>;

std::vector<double> uneven_steps(std::size_t n, std::mt19937& rng) {
  std::uniform_real_distribution<double> step(0.05, 0.15);
  std::vector<double> steps(n);
  for (double& s : steps) s = step(rng);
  return steps;
}

// A vehicle's way: gentle swings, sampled with noise.
Curve swings(const std::vector<double>& steps, double noise, std::mt19937& rng, Curve* truth = nullptr) {
  std::normal_distribution<double> normal(0.0, noise);
  Curve y;
  double t = 0.0;
  for (std::size_t i = 0; i <= steps.size(); ++i) {
    const double x = 8.0 * t + 2.0 * std::sin(0.7 * t) + 0.3 * std::sin(2.0 * t + 1.0);
    if (truth) truth->push_back(x);
    y.push_back(noise > 0.0 ? x + normal(rng) : x);
    if (i < steps.size()) t += steps[i];
  }
  return y;
}

double rms(const Curve& a, const Curve& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(MotionSmoothing, IsTheOptimumOfTheDenseProblem) {
  std::mt19937 rng(1);
  const auto steps = uneven_steps(40, rng);
  const Curve y = swings(steps, 0.05, rng);
  const SmoothCurve s = smooth_curve({y}, steps);
  // The same problem with dense matrices over all states, the unit of time the median step.
  auto sorted = steps;
  std::sort(sorted.begin(), sorted.end());
  const double unit = sorted[sorted.size() / 2], q = std::pow(10.0, s.log10_ratio);
  const auto n = static_cast<Eigen::Index>(y.size());
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(3 * n);
  for (Eigen::Index i = 0; i < n; ++i) {
    a(3 * i, 3 * i) += 1.0;
    b[3 * i] += y[static_cast<std::size_t>(i)];
    if (i + 1 == n) break;
    const double t = steps[static_cast<std::size_t>(i)] / unit;
    Eigen::Matrix3d f, cov;
    f << 1, t, t * t / 2, 0, 1, t, 0, 0, 1;
    cov << std::pow(t, 5) / 20, std::pow(t, 4) / 8, std::pow(t, 3) / 6, std::pow(t, 4) / 8,
        std::pow(t, 3) / 3, t * t / 2, std::pow(t, 3) / 6, t * t / 2, t;
    Eigen::Matrix<double, 3, 6> j;
    j << -f, Eigen::Matrix3d::Identity();
    a.block<6, 6>(3 * i, 3 * i) += j.transpose() * (q * cov).inverse() * j;
  }
  const Eigen::VectorXd x = a.fullPivLu().solve(b);
  for (Eigen::Index i = 0; i < n; ++i) EXPECT_NEAR(s.values[0][static_cast<std::size_t>(i)], x[3 * i], 1e-5);
}

TEST(MotionSmoothing, TellsNoiseFromMotion) {
  for (const double noise : {0.003, 0.03, 0.3}) {
    std::mt19937 rng(7);
    const auto steps = uneven_steps(600, rng);
    Curve truth;
    const Curve y = swings(steps, noise, rng, &truth);
    const SmoothCurve s = smooth_curve({y}, steps);
    EXPECT_NEAR(s.noise, noise, 0.15 * noise);
    EXPECT_LT(rms(s.values[0], truth), 0.6 * rms(y, truth)) << noise;
  }
}

TEST(MotionSmoothing, LeavesAMotionWithoutNoiseWhereItIs) {
  std::mt19937 rng(3);
  const auto steps = uneven_steps(300, rng);
  const Curve y = swings(steps, 0.0, rng);
  EXPECT_LT(rms(smooth_curve({y}, steps).values[0], y), 1e-3);
  // Braking hard from 10 m/s is motion too.
  Curve braking;
  double x = 0.0, v = 10.0;
  std::normal_distribution<double> normal(0.0, 0.005);
  Curve truth;
  for (int i = 0; i < 300; ++i) {
    truth.push_back(x);
    braking.push_back(x + normal(rng));
    x += 0.1 * v;
    if (i > 150) v = std::max(0.0, v - 0.7);
  }
  EXPECT_LT(rms(smooth_curve({braking}, std::vector<double>(299, 0.1)).values[0], truth), 0.006);
  // Standing still, and too few samples to say anything.
  const Curve still(50, 3.0);
  EXPECT_EQ(smooth_curve({still}, std::vector<double>(49, 0.1)).values[0], still);
  EXPECT_EQ(smooth_curve({{1, 5, 2, 8}}, {1, 1, 1}).values[0], (Curve{1, 5, 2, 8}));
}

struct Drive {
  std::vector<Submap> submaps;
  std::vector<TrajectoryPose> trajectory;
  std::vector<Pose> truth;
};

// Round and round, the heading over many turns.
Drive turning_drive(int n, double noise_m, double noise_rad) {
  std::mt19937 rng(11);
  std::normal_distribution<double> normal;
  Drive d;
  d.submaps.resize(1);
  for (int i = 0; i < n; ++i) {
    const double a = 0.1 * i;
    const Pose truth(so3_exp({0, 0, a}), {8 * std::cos(a), 8 * std::sin(a), 0.1 * std::sin(0.5 * a)});
    Vector6d x;
    for (int k = 0; k < 6; ++k) x[k] = normal(rng) * (k < 3 ? noise_m : noise_rad);
    TrajectoryPose p;
    p.sequence = i;
    p.utime = 100000 * i;
    p.map_from_sensor = p.odom_from_sensor = truth * se3_exp(x);
    d.truth.push_back(truth);
    d.trajectory.push_back(p);
    ScanPose s;
    s.sequence = i;
    s.utime = p.utime;
    d.submaps[0].scans.push_back(s);
  }
  return d;
}

TEST(MotionSmoothing, PosesOfATurningSensor) {
  Drive d = turning_drive(500, 0.02, 0.01);
  const auto before = d.trajectory;
  smooth_trajectory(d.submaps, d.trajectory);
  const auto error = [&](const std::vector<TrajectoryPose>& poses) {
    Eigen::Vector2d sum(0, 0);
    for (std::size_t i = 0; i < poses.size(); ++i) {
      const Pose off = d.truth[i].inverse() * poses[i].map_from_sensor;
      sum += Eigen::Vector2d(off.translation.squaredNorm(), std::pow(rotation_angle(off.rotation), 2));
    }
    return sum;
  };
  const Eigen::Vector2d was = error(before), is = error(d.trajectory);
  EXPECT_LT(is[0], 0.5 * was[0]);
  EXPECT_LT(is[1], 0.5 * was[1]);
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(before[i].odom_from_sensor.translation, d.trajectory[i].odom_from_sensor.translation);
  }
}

TEST(MotionSmoothing, DoesNotReachAcrossALoss) {
  Drive d = turning_drive(200, 0.01, 0.005);
  Drive shifted = d;
  for (std::size_t i = 90; i < 200; ++i) shifted.trajectory[i].map_from_sensor.translation.x() += 30.0;
  for (Drive* each : {&d, &shifted}) {
    each->submaps[0].scans[90].state = TrackingState::kLost;
    smooth_trajectory(each->submaps, each->trajectory);
  }
  for (std::size_t i = 0; i < 200; ++i) {
    const double expected = i < 90 ? 0.0 : 30.0;
    EXPECT_NEAR(shifted.trajectory[i].map_from_sensor.translation.x() -
                    d.trajectory[i].map_from_sensor.translation.x(),
                expected, 1e-6)
        << i;
  }
}

TEST(MotionSmoothing, SaysNothingOfScansASecondApart) {
  Drive d = turning_drive(100, 0.02, 0.01);
  for (TrajectoryPose& p : d.trajectory) p.utime *= 10;
  const auto before = d.trajectory;
  smooth_trajectory(d.submaps, d.trajectory);
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(before[i].map_from_sensor.translation, d.trajectory[i].map_from_sensor.translation);
  }
}

TEST(MotionSmoothing, FindsNoiseAndJerkAnewAlongTheWay) {
  // A quiet half, then one that is shaken and noisy.
  std::mt19937 rng(5);
  std::normal_distribution<double> normal;
  Drive d = turning_drive(1200, 0.0, 0.0);
  for (std::size_t i = 0; i < 1200; ++i) {
    const double t = 0.1 * static_cast<double>(i);
    const bool shaken = i >= 600;
    Eigen::Vector3d& truth = d.truth[i].translation;
    if (shaken) truth.z() += 0.2 * std::sin(6.0 * t);
    const double noise = shaken ? 0.05 : 0.01;
    d.trajectory[i].map_from_sensor.translation =
        truth + noise * Eigen::Vector3d(normal(rng), normal(rng), normal(rng));
  }
  const auto before = d.trajectory;
  smooth_trajectory(d.submaps, d.trajectory);
  for (const std::size_t half : {std::size_t{0}, std::size_t{600}}) {
    double was = 0.0, is = 0.0;
    for (std::size_t i = half; i < half + 600; ++i) {
      was += (before[i].map_from_sensor.translation - d.truth[i].translation).squaredNorm();
      is += (d.trajectory[i].map_from_sensor.translation - d.truth[i].translation).squaredNorm();
    }
    EXPECT_LT(is, 0.6 * was) << half;
  }
}

TEST(MotionSmoothing, TimesThatStandStillOrGoBackDoNoHarm) {
  Drive d = turning_drive(100, 0.01, 0.005);
  for (std::size_t i = 30; i < 40; ++i) d.trajectory[i].utime = 0;
  smooth_trajectory(d.submaps, d.trajectory);
  for (std::size_t i = 0; i < 100; ++i) {
    ASSERT_TRUE(d.trajectory[i].map_from_sensor.is_finite());
    EXPECT_LT((d.trajectory[i].map_from_sensor.translation - d.truth[i].translation).norm(), 0.3);
  }
  std::vector<TrajectoryPose> none;
  smooth_trajectory({}, none);
}

TEST(MotionSmoothing, WhoReadsTheSessionSeesWhatTheBackEndSays) {
  for (const bool smooth : {true, false}) {
    testing::TemporaryFolder folder;
    SessionStore store(folder.path());
    BackendConfig config;
    config.smooth_scans = smooth;
    Backend backend(config, store);
    Pose odom;
    for (int k = 0; k < 4; ++k) {
      Submap m = testing::random_submap(k, odom, 200, 30);
      odom = odom * m.scans.back().submap_from_sensor;
      backend.add_submap(m, {}, k == 3);
    }
    const auto open = backend.graph().trajectory;
    backend.finish();
    const auto& ended = backend.graph().trajectory;
    const auto read = store.read_graph().trajectory;
    ASSERT_EQ(read.size(), ended.size());
    double moved = 0.0;
    for (std::size_t i = 0; i < read.size(); ++i) {
      EXPECT_EQ(read[i].map_from_sensor.translation, ended[i].map_from_sensor.translation);
      EXPECT_EQ(read[i].map_from_sensor.rotation.coeffs(), ended[i].map_from_sensor.rotation.coeffs());
      moved += (open[i].map_from_sensor.translation - ended[i].map_from_sensor.translation).norm();
    }
    EXPECT_EQ(moved > 0.0, smooth);
  }
}

}  // namespace
}  // namespace hp2
