#include "backend/places/ransac_2d.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace hp2 {
namespace {

std::vector<PointPair> matches(int good, int bad, double angle, const Eigen::Vector2d& t, unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> area(-60.0, 60.0);
  std::normal_distribution<double> noise(0.0, 0.3);
  std::vector<PointPair> pairs;
  for (int i = 0; i < good + bad; ++i) {
    const Eigen::Vector2d q(area(rng), area(rng));
    const Eigen::Vector2d r =
        i < good
            ? Eigen::Vector2d(Eigen::Rotation2Dd(angle) * q + t + Eigen::Vector2d(noise(rng), noise(rng)))
            : Eigen::Vector2d(area(rng), area(rng));
    pairs.push_back({r, q});
  }
  std::shuffle(pairs.begin(), pairs.end(), rng);
  return pairs;
}

TEST(Ransac2d, EightyPercentOutliers) {
  for (unsigned seed = 0; seed < 50; ++seed) {
    const double angle = -3.0 + 0.12 * seed;
    const Eigen::Vector2d t(20.0 - seed, 3.0 * std::sin(seed));
    const auto a = align_2d(matches(20, 80, angle, t, seed), 1.5, 5);
    ASSERT_GE(a.inliers, 17) << seed;
    EXPECT_NEAR(std::remainder(a.angle - angle, 2 * M_PI), 0.0, 0.02) << seed;
    EXPECT_LT((a.translation - t).norm(), 0.6) << seed;
  }
}

TEST(Ransac2d, TheSameInputGivesTheSameResult) {
  const auto pairs = matches(30, 270, 1.0, {5, 6}, 3);
  const auto a = align_2d(pairs, 1.5, 5), b = align_2d(pairs, 1.5, 5);
  EXPECT_EQ(a.angle, b.angle);
  EXPECT_EQ(a.translation, b.translation);
  EXPECT_EQ(a.inliers, b.inliers);
}

TEST(Ransac2d, FindsNothingWhereThereIsNothing) {
  EXPECT_EQ(align_2d({}, 1.5, 5).inliers, 0);
  EXPECT_EQ(align_2d(matches(4, 0, 0.5, {1, 1}, 1), 1.5, 5).inliers, 0);
  int found = 0;
  for (unsigned seed = 0; seed < 20; ++seed)
    found += align_2d(matches(0, 60, 0, {0, 0}, seed), 1.5, 8).inliers > 0;
  EXPECT_EQ(found, 0);
}

TEST(Ransac2d, OneCornerMatchedManyTimesIsOneWitness) {
  std::vector<PointPair> pairs;
  for (int i = 0; i < 20; ++i) pairs.push_back({{1.0, 2.0}, {3.0 + 0.01 * i, 4.0}});
  for (int i = 0; i < 20; ++i) pairs.push_back({{21.0, 2.0}, {23.0 + 0.01 * i, 4.0}});
  EXPECT_EQ(align_2d(pairs, 1.5, 5).inliers, 0);
}

}  // namespace
}  // namespace hp2
