// Ground alignment, density image, features: from a submap's points to what its place looks like from above.
#include <cmath>
#include <random>

#include <gtest/gtest.h>

#include "backend/places/density_image.hpp"
#include "backend/places/features.hpp"
#include "backend/places/ground_alignment.hpp"
#include "backend_fixtures.hpp"

namespace hp2 {
namespace {

using testing::street_scene;

double degrees(double radians) { return radians * 180.0 / M_PI; }

// Angle between the ground's normal found and the true one.
double tilt_error(const GroundAlignment& found, const Pose& submap_from_scene) {
  const Eigen::Vector3d up = submap_from_scene.rotation * Eigen::Vector3d::UnitZ();
  return degrees(std::acos(std::min(1.0, (found.ground_from_submap.rotation * up).z())));
}

class TiltedGround : public ::testing::TestWithParam<Eigen::Vector3d> {};

TEST_P(TiltedGround, IsFoundUnderClutter) {
  // A street with houses, cars and trees, seen by a sensor 1.8 m above it that is mounted askew.
  const Pose submap_from_scene = Pose(so3_exp(GetParam()), {0, 0, 0}) * Pose({1, 0, 0, 0}, {0, 0, -1.8});
  const auto points = street_scene(1, 0.03, submap_from_scene);
  std::vector<Eigen::Vector3d> path;
  for (int i = -10; i <= 10; ++i) path.push_back(submap_from_scene * Eigen::Vector3d(i, 0, 1.8));
  const auto ground = align_ground(points, path);
  ASSERT_TRUE(ground.found);
  EXPECT_LT(tilt_error(ground, submap_from_scene), 0.5);
  EXPECT_NEAR((ground.ground_from_submap * Eigen::Vector3d(0, 0, 0)).z(), 1.8, 0.1);
}

INSTANTIATE_TEST_SUITE_P(Mounts, TiltedGround,
                         ::testing::Values(Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.1, 0, 0),
                                           Eigen::Vector3d(0, 0.35, 0.5), Eigen::Vector3d(-0.3, 0.3, 2.0),
                                           Eigen::Vector3d(0.6, 0, 0)));

TEST(GroundAlignment, SaysThatThereIsNone) {
  std::mt19937 rng(1);
  std::normal_distribution<float> normal(0.0F, 20.0F);
  std::vector<Eigen::Vector3f> cloud;
  for (int i = 0; i < 3000; ++i) cloud.emplace_back(normal(rng), normal(rng), normal(rng));
  EXPECT_FALSE(align_ground(cloud, {{0, 0, 0}}).found);
  EXPECT_TRUE(align_ground(cloud, {}).ground_from_submap.translation.isZero());
  // Two walls of a canyon and nothing below.
  std::vector<Eigen::Vector3f> walls;
  for (int i = 0; i < 60; ++i) {
    for (int j = 0; j < 20; ++j) {
      walls.emplace_back(0.5F * i, 8.0F, 0.5F * j);
      walls.emplace_back(0.5F * i, -8.0F, 0.5F * j);
    }
  }
  EXPECT_FALSE(align_ground(walls, {{0, 0, 0}, {20, 0, 0}}).found);
  EXPECT_FALSE(align_ground({}, {}).found);
  EXPECT_FALSE(align_ground({{NAN, 0, 0}, {INFINITY, 0, 0}}, {}).found);
}

TEST(GroundAlignment, ACeilingIsNoGround) {
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 60; ++i) {
    for (int j = -8; j < 8; ++j) {
      points.emplace_back(0.5F * i, 0.5F * j, 1.5F);                   // the whole ceiling is seen,
      if (i % 3 == 0) points.emplace_back(0.5F * i, 0.5F * j, -1.2F);  // of the floor a third
    }
  }
  const auto ground = align_ground(points, {{0, 0, 0}, {15, 0, 0}});
  ASSERT_TRUE(ground.found);
  EXPECT_NEAR(ground.ground_from_submap.translation.z(), 1.2, 0.02);
}

TEST(DensityImage, OfAKnownScene) {
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 20; ++i)
    points.emplace_back(0.25F, 0.25F, 0.3F * static_cast<float>(i));  // a pole of 20 points
  for (int i = 0; i < 10; ++i) points.emplace_back(-1.25F, 2.25F, 0.3F * static_cast<float>(i));  // one of 10
  points.emplace_back(5.25F, 0.25F, 0.0F);                                                        // one point
  points.emplace_back(NAN, 0.0F, 0.0F);
  points.emplace_back(1e9F, 0.0F, 0.0F);
  const DensityImage image = make_density_image(points, Pose(), 0.5, 0.06);
  ASSERT_EQ(image.width, 14);
  ASSERT_EQ(image.height, 5);
  EXPECT_EQ(image.min_m, Eigen::Vector2d(-1.5, 0.0));
  // With three occupied cells the 99th percentile is the second densest: both poles are white.
  EXPECT_EQ(image.at(3, 0), 255);
  EXPECT_EQ(image.at(0, 4), 255);
  EXPECT_EQ(image.at(13, 0), 26);
  EXPECT_EQ(make_density_image(points, Pose(), 0.5, 0.15).at(13, 0), 0);
  int occupied = 0;
  for (const auto p : image.pixels) occupied += p > 0;
  EXPECT_EQ(occupied, 3);
  EXPECT_TRUE(make_density_image({}, Pose(), 0.5, 0.05).pixels.empty());
}

TEST(Features, TheSamePlaceSeenFromElsewhereHasTheSameFeatures) {
  const BackendConfig config;
  const Pose moved({std::cos(1.2), 0, 0, std::sin(1.2)}, {7.3, -4.1, 0});
  const auto a =
      extract_features(make_density_image(street_scene(1, 0.02, Pose()), Pose(), 0.5, 0.05), config);
  const auto b =
      extract_features(make_density_image(street_scene(2, 0.02, moved), Pose(), 0.5, 0.05), config);
  ASSERT_GT(a.descriptors.size(), 50U);
  ASSERT_EQ(a.descriptors.size(), a.keypoints.size());
  int right = 0;
  for (std::size_t i = 0; i < b.descriptors.size(); ++i) {
    for (std::size_t j = 0; j < a.descriptors.size(); ++j) {
      if (hamming_distance(a.descriptors[j], b.descriptors[i]) > config.match_bits) continue;
      const Eigen::Vector3d there = moved * Eigen::Vector3d(a.keypoints[j].x(), a.keypoints[j].y(), 0);
      right += (there.head<2>() - b.keypoints[i].cast<double>()).norm() < 1.5;
    }
  }
  EXPECT_GE(right, 10);
}

TEST(Features, NoTwoOfAnImageAreAlike) {
  const BackendConfig config;
  const auto f =
      extract_features(make_density_image(street_scene(1, 0.02, Pose()), Pose(), 0.5, 0.05), config);
  for (std::size_t i = 0; i < f.descriptors.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      EXPECT_GT(hamming_distance(f.descriptors[i], f.descriptors[j]), config.self_similar_bits);
    }
  }
}

}  // namespace
}  // namespace hp2
