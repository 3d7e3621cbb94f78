#include "backend/graph/pose_graph.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

Vector6d random_vector(std::mt19937& rng, double translation, double rotation) {
  std::normal_distribution<double> normal;
  Vector6d x;
  for (int i = 0; i < 6; ++i) x[i] = normal(rng) * (i < 3 ? translation : rotation);
  return x;
}

Matrix6d information(double translation, double rotation) {
  Vector6d d;
  d.head<3>().setConstant(1.0 / (translation * translation));
  d.tail<3>().setConstant(1.0 / (rotation * rotation));
  return d.asDiagonal();
}

double rms(const std::vector<Pose>& a, const std::vector<Pose>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i].translation - b[i].translation).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(PoseGraph, JacobiansEqualNumericOnes) {
  std::mt19937 rng(1);
  for (int round = 0; round < 50; ++round) {
    const Pose a = se3_exp(random_vector(rng, 20.0, 0.8)), b = se3_exp(random_vector(rng, 20.0, 0.8));
    const Pose z = a.inverse() * b * se3_exp(random_vector(rng, 1.0, round < 25 ? 0.1 : 0.7));
    Matrix6d by_a, by_b;
    const Vector6d e = edge_error(a, b, z, &by_a, &by_b);
    if (e.tail<3>().norm() > 2.5) continue;
    const double h = 1e-6;
    for (int i = 0; i < 6; ++i) {
      Vector6d x = Vector6d::Zero();
      x[i] = h;
      const Vector6d numeric_a = (edge_error(a * se3_exp(x), b, z, nullptr, nullptr) -
                                  edge_error(a * se3_exp(-x), b, z, nullptr, nullptr)) /
                                 (2 * h);
      const Vector6d numeric_b = (edge_error(a, b * se3_exp(x), z, nullptr, nullptr) -
                                  edge_error(a, b * se3_exp(-x), z, nullptr, nullptr)) /
                                 (2 * h);
      EXPECT_LT((by_a.col(i) - numeric_a).norm(), 1e-4 * (1.0 + numeric_a.norm())) << round << " " << i;
      EXPECT_LT((by_b.col(i) - numeric_b).norm(), 1e-4 * (1.0 + numeric_b.norm())) << round << " " << i;
    }
  }
}

// Poses on a sphere, ring over ring, as in the well-known benchmark; closures between neighbouring rings.
struct Sphere {
  std::vector<Pose> truth;
  std::vector<GraphEdge> odometry, closures;
};

Sphere sphere(int rings, int per_ring, double translation_noise, double rotation_noise, unsigned seed) {
  std::mt19937 rng(seed);
  Sphere s;
  for (int r = 0; r < rings; ++r) {
    for (int k = 0; k < per_ring; ++k) {
      const double azimuth =
          2.0 * M_PI * (k + static_cast<double>(r * per_ring + k) / (rings * per_ring)) / per_ring;
      const double height = M_PI * (static_cast<double>(r * per_ring + k) / (rings * per_ring) - 0.5) * 0.9;
      const Eigen::Vector3d p =
          50.0 * Eigen::Vector3d(std::cos(height) * std::cos(azimuth), std::cos(height) * std::sin(azimuth),
                                 std::sin(height));
      s.truth.emplace_back(so3_exp({0, 0, azimuth}) * so3_exp({0, -height, 0}), p);
    }
  }
  const Pose first = s.truth[0].inverse();
  for (Pose& p : s.truth) p = first * p;
  const auto edge = [&](std::size_t a, std::size_t b) {
    const Vector6d noise = random_vector(rng, translation_noise, rotation_noise);
    return GraphEdge{a, b, s.truth[a].inverse() * s.truth[b] * se3_exp(noise),
                     information(std::max(translation_noise, 1e-3), std::max(rotation_noise, 1e-4))};
  };
  for (std::size_t i = 0; i + 1 < s.truth.size(); ++i) s.odometry.push_back(edge(i, i + 1));
  for (std::size_t i = 0; i + static_cast<std::size_t>(per_ring) < s.truth.size(); i += 2) {
    s.closures.push_back(edge(i, i + static_cast<std::size_t>(per_ring)));
  }
  return s;
}

std::vector<Pose> chained(const Sphere& s) {
  std::vector<Pose> nodes{s.truth[0]};
  for (const auto& e : s.odometry) nodes.push_back(nodes.back() * e.from_from_to);
  return nodes;
}

TEST(PoseGraph, WithoutNoiseTheTruthIsReachedFromFarOff) {
  const Sphere s = sphere(10, 30, 0.0, 0.0, 1);
  std::mt19937 rng(2);
  auto nodes = s.truth;
  for (std::size_t i = 1; i < nodes.size(); ++i) nodes[i] = nodes[i] * se3_exp(random_vector(rng, 1.0, 0.1));
  const auto summary = optimise(nodes, s.odometry, s.closures, 0.0);
  EXPECT_TRUE(summary.converged);
  EXPECT_LT(rms(nodes, s.truth), 1e-3);
  EXPECT_LT(summary.final_cost, 1e-6 * summary.initial_cost);
}

TEST(PoseGraph, ReachesTheOptimumOfANoisySphere) {
  const Sphere s = sphere(12, 40, 0.02, 0.005, 3);
  auto nodes = chained(s);
  const double before = rms(nodes, s.truth);
  const auto summary = optimise(nodes, s.odometry, s.closures, 0.0);
  EXPECT_LT(rms(nodes, s.truth), 0.5 * before);
  // At the optimum of a least-squares problem of honest noise the cost is half of the redundancy, give or
  // take.
  const double redundancy =
      6.0 * static_cast<double>(s.odometry.size() + s.closures.size() - (s.truth.size() - 1));
  EXPECT_NEAR(summary.final_cost, 0.5 * redundancy, 4.0 * std::sqrt(0.5 * redundancy));
  // From the truth the same optimum is reached: it is no local one.
  auto from_truth = s.truth;
  const auto again = optimise(from_truth, s.odometry, s.closures, 0.0);
  EXPECT_NEAR(again.final_cost, summary.final_cost, 1e-3 * summary.final_cost);
  EXPECT_EQ(nodes[0].translation, s.truth[0].translation);
}

TEST(PoseGraph, AFalseClosureAmongTrueOnesDoesNotBendTheMap) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Sphere s = sphere(8, 30, 0.03, 0.004, 10 + seed);
    auto good = chained(s);
    auto used = optimise_consistent(good, s.odometry, s.closures);
    EXPECT_EQ(std::count(used.begin(), used.end(), true), static_cast<std::ptrdiff_t>(s.closures.size()));
    auto closures = s.closures;
    GraphEdge wrong = closures[5];  // as if two places looked alike: off by tens of metres
    wrong.from = 10;
    wrong.to = 10 + 30 * (2 + seed);
    closures.insert(closures.begin() + 7, wrong);
    auto bent = chained(s);
    used = optimise_consistent(bent, s.odometry, closures);
    EXPECT_FALSE(used[7]) << seed;
    EXPECT_EQ(std::count(used.begin(), used.end(), true), static_cast<std::ptrdiff_t>(s.closures.size()))
        << seed;
    EXPECT_LT(rms(bent, s.truth), 1.1 * rms(good, s.truth)) << seed;
  }
}

TEST(PoseGraph, OdometryThatPromisesTooMuchStillLetsLoopsClose) {
  Sphere s = sphere(8, 30, 0.03, 0.004, 4);
  for (GraphEdge& e : s.odometry) e.information *= 1e4;  // says to be a hundred times as good as it is
  auto nodes = chained(s);
  const double before = rms(nodes, s.truth);
  const auto used = optimise_consistent(nodes, s.odometry, s.closures);
  EXPECT_EQ(std::count(used.begin(), used.end(), true), static_cast<std::ptrdiff_t>(s.closures.size()));
  EXPECT_LT(rms(nodes, s.truth), 0.5 * before);
}

TEST(PoseGraph, NothingToDoIsNoError) {
  std::vector<Pose> none, one(1);
  EXPECT_NO_THROW(optimise(none, {}, {}));
  EXPECT_NO_THROW(optimise(one, {}, {}));
  EXPECT_TRUE(optimise_consistent(one, {}, {}).empty());
}

}  // namespace
}  // namespace hp2
