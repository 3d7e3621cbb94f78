#include "frontend/odometry/map_scale.hpp"

#include <gtest/gtest.h>

namespace hp2 {
namespace {

constexpr double kDense = 4.0, kLines = 2.0, kFar_m = 50.0;

double settled(double growth, double mean_range_m) {
  MapScale scale;
  scale.add_growth(growth);
  scale.settle(mean_range_m);
  return scale.voxel_m();
}

TEST(MapScale, IsLargestUntilSomethingIsMeasured) {
  MapScale scale;
  scale.settle(1.0);
  EXPECT_EQ(scale.voxel_m(), MapScaleConfig().largest_m);
}

TEST(MapScale, DenseSurfacesHaveSmallVoxelsAndLinesLargeOnes) {
  EXPECT_NEAR(settled(kDense, kFar_m), MapScaleConfig().smallest_m, 1e-9);
  EXPECT_EQ(settled(kLines, kFar_m), MapScaleConfig().largest_m);
}

TEST(MapScale, WhereAllIsNearVoxelsAreAShareOfTheRange) {
  EXPECT_NEAR(settled(kLines, 10.0), 0.4, 1e-9);
  EXPECT_NEAR(settled(kLines, 2.0), MapScaleConfig().least_m, 1e-9);
}

TEST(MapScale, ASmallChangeOfTheRangeLeavesTheVoxelAsItIs) {
  MapScale scale;
  scale.add_growth(kLines);
  scale.settle(10.0);
  const double before = scale.voxel_m();
  scale.settle(10.5);
  EXPECT_EQ(scale.voxel_m(), before);
  scale.settle(18.0);
  EXPECT_NEAR(scale.voxel_m(), 0.72, 1e-9);
}

}  // namespace
}  // namespace hp2
