// How the registration iterates: far in few steps where it is told to.
#include "frontend/hybrid_icp.hpp"

#include <gtest/gtest.h>

#include "frontend/frontend_config.hpp"
#include "frontend/parallel.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using test::Cloud;

// Along x little tells where one is: boards across the way, among much that does not.
Cloud street(unsigned seed, int per_wall) {
  Cloud c = test::corridor(seed, per_wall);
  test::Dice dice(seed + 1000);
  for (double x = -20.0; x < 25.0; x += 8.0) {
    test::add_patch(c, dice, per_wall / 40, {x, 3, 0}, {0, 2.5, 0}, {0, 0, 2});
  }
  return c;
}

struct Slide {
  IcpResult result;
  double off_m;
};

// A street registered from a guess that is off by `off` [m] along it.
Slide slide(const Cloud& source, double off, bool accelerated, int iterations) {
  FrontendConfig config;
  IcpConfig icp = icp_config(config);
  icp.max_iterations = iterations;
  LocalMap map(config.voxel_size_m, config.max_points_per_voxel, config.min_spacing_m);
  const Parallel parallel(1);
  map.insert(street(1, 6000), Pose(), Eigen::Vector3d::Zero());
  HybridIcp registration(icp);
  registration.set_accelerated(accelerated);
  Slide out;
  const Pose guess(Eigen::Quaterniond::Identity(), Eigen::Vector3d(off, 0.0, 0.0));
  out.result = registration.align(map, source, guess, 0.5, parallel);
  out.off_m = out.result.map_from_source.translation.norm();
  return out;
}

TEST(HybridIcp, AcceleratedReachesFartherInAsManyIterations) {
  const Cloud source = street(2, 1500);
  double plain_off = 0.0, accelerated_off = 0.0;
  for (const double off : {0.8, 0.9, 1.0, 1.1}) {
    const Slide plain = slide(source, off, false, 15), accelerated = slide(source, off, true, 30);
    EXPECT_LE(accelerated.result.iterations, 15) << off;
    EXPECT_LE(accelerated.off_m, plain.off_m) << off;
    plain_off += plain.off_m;
    accelerated_off += accelerated.off_m;
  }
  EXPECT_GT(plain_off, 1.5);  // it is far for one step after the other
  EXPECT_LT(accelerated_off, 0.5 * plain_off);
}

TEST(HybridIcp, AcceleratedEndsWhereItWouldWithout) {
  const Cloud source = street(2, 1500);
  for (const double off : {-0.7, 0.3, 0.5, 0.7}) {
    const Slide plain = slide(source, off, false, 30), accelerated = slide(source, off, true, 30);
    EXPECT_TRUE(plain.result.converged && accelerated.result.converged) << off;
    EXPECT_LT(accelerated.off_m, 0.005) << off;
    EXPECT_NEAR(accelerated.off_m, plain.off_m, 0.003) << off;
  }
}

TEST(HybridIcp, FewerIterationsThanAcceleratedOnesStayFewer) {
  const Cloud source = street(2, 1500);
  EXPECT_EQ(slide(source, 1.1, true, 4).result.iterations, 4);
}

}  // namespace
}  // namespace hp2
