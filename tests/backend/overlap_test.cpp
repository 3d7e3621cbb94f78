#include "backend/closures/overlap.hpp"

#include <random>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

std::vector<Eigen::Vector3f> scattered(unsigned seed, int n, float reach) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> at(-reach, reach);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < n; ++i) points.emplace_back(at(rng), at(rng), 0.2F * at(rng));
  return points;
}

TEST(VoxelCloud, NearestIsTheOneThatLookingAtAllFinds) {
  const VoxelCloud cloud(scattered(1, 6000, 8.0F), {}, Pose());
  const float reach = 0.25F;  // as far as the eight voxels around a point surely reach
  int found = 0;
  for (const Eigen::Vector3f& p : scattered(2, 4000, 9.0F)) {
    const VoxelCloud::Voxel* best = nullptr;
    for (const auto& v : cloud.voxels()) {
      const float d = (v.point - p).norm();
      if (d <= reach && (best == nullptr || d < (best->point - p).norm())) best = &v;
    }
    EXPECT_EQ(cloud.nearest(p, reach), best) << p.transpose();
    EXPECT_EQ(cloud.any_near(p, reach), best != nullptr) << p.transpose();
    found += best != nullptr;
  }
  EXPECT_GT(found, 500);
}

TEST(VoxelCloud, OnePointAVoxelTheFirstOne) {
  const std::vector<Eigen::Vector3f> points{{0.1F, 0.1F, 0.1F}, {0.4F, 0.4F, 0.4F}, {-0.1F, 0.1F, 0.1F},
                                            {0.5F, 0.1F, 0.1F}, {NAN, 0.0F, 0.0F},  {1e6F, 0, 0}};
  const VoxelCloud cloud(points, {}, Pose());
  ASSERT_EQ(cloud.voxels().size(), 3U);
  for (const std::size_t i : {0, 2, 3}) EXPECT_EQ(cloud.nearest(points[i], 0.1F)->point, points[i]);
  EXPECT_EQ(cloud.nearest({0.4F, 0.4F, 0.4F}, 0.1F), nullptr);
}

TEST(VoxelCloud, SeenAreColumnsOfTwoMetres) {
  const VoxelCloud cloud({{-0.5F, 3.0F, 7.0F}, {-1.5F, 2.5F, -30.0F}}, {}, Pose());
  EXPECT_EQ(cloud.column_count(), 1U);
  EXPECT_TRUE(cloud.seen({-1.9F, 2.1F, 0.0F}));
  EXPECT_FALSE(cloud.seen({0.1F, 2.1F, 7.0F}));
  EXPECT_FALSE(cloud.seen({-1.9F, 1.9F, 7.0F}));
}

}  // namespace
}  // namespace hp2
