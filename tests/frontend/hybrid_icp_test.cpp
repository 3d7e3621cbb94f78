// How the registration iterates: far in few steps where it is told to.
#include "common/registration/hybrid_icp.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "common/registration/parallel.hpp"
#include "frontend/frontend_config.hpp"
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
  LocalMap map(MapSizes().voxel_m, config.max_points_per_voxel, MapSizes().spacing_m);
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

// Where point-to-point ends from guesses `off` [m] ahead and behind, the one less the other.
double left_of_the_guess(double off, double times_convergence) {
  FrontendConfig config;
  config.mode = "point_to_point";
  IcpConfig icp = icp_config(config);
  icp.convergence_m *= times_convergence;
  LocalMap map(MapSizes().voxel_m, config.max_points_per_voxel, MapSizes().spacing_m);
  const Parallel parallel(1);
  map.insert(test::room(1), Pose());
  HybridIcp registration(icp);
  const Cloud source = test::room(2, 1500);
  const auto end = [&](double x) {
    const Pose guess(Eigen::Quaterniond::Identity(), Eigen::Vector3d(x, 0.0, 0.0));
    return registration.align(map, source, guess, 0.5, parallel).map_from_source.translation.x();
  };
  return end(off) - end(-off);
}

TEST(HybridIcp, PointToPointDoesNotStopOnTheWay) {
  for (const double off : {0.03, 0.1, 0.3}) {
    EXPECT_LT(left_of_the_guess(off, 1.0), 0.007) << off;
    EXPECT_GT(left_of_the_guess(off, 3.0), 0.01) << off;  // what it is about: as other modes stop
  }
}

// What registration says of `source`, whose true pose is the identity, and what is left after refining it.
struct Refined {
  IcpResult wide, narrow;
};

Refined refined(const Cloud& map_points, const Cloud& source, const Eigen::Vector3d& off, double sigma_m) {
  FrontendConfig config;
  LocalMap map(MapSizes().voxel_m, config.max_points_per_voxel, MapSizes().spacing_m);
  const Parallel parallel(1);
  map.insert(map_points, Pose());
  HybridIcp registration(icp_config(config));
  const Pose guess(Eigen::Quaterniond::Identity(), off);
  Refined out;
  out.wide = registration.align(map, source, guess, sigma_m, parallel);
  out.narrow = registration.refine(map, source, out.wide.map_from_source, sigma_m, parallel);
  return out;
}

TEST(HybridIcp, RefinedItIsNotHeldBackByWhatComesInSightBehindThings) {
  Cloud source = test::room(2, 1500);
  test::Dice dice(3);
  // A part of the wall ahead has gone from sight, and with it what stands a little behind it has come in.
  test::add_patch(source, dice, 1000, {12.2, -8, -2}, {0, 16, 0}, {0, 0, 6});
  const Refined r = refined(test::room(1), source, {0.1, -0.1, 0.05}, 0.3);
  EXPECT_GT(std::abs(r.wide.map_from_source.translation.x()), 0.01);
  EXPECT_LT(std::abs(r.narrow.map_from_source.translation.x()),
            0.3 * std::abs(r.wide.map_from_source.translation.x()));
  EXPECT_LT(r.narrow.map_from_source.translation.norm(), 0.01);
  EXPECT_LE(r.narrow.iterations, 5);
  EXPECT_TRUE(r.narrow.converged);
}

TEST(HybridIcp, RefiningLeavesAWeakDirectionAsItWas) {
  const Refined r = refined(test::corridor(1), test::corridor(2, 1500), {0.0, 0.1, 0.05}, 0.3);
  EXPECT_LT(r.wide.min_eigenvalue_ratio, 0.03);
  EXPECT_NEAR(r.narrow.map_from_source.translation.x(), r.wide.map_from_source.translation.x(), 1e-3);
  EXPECT_NEAR(r.narrow.map_from_source.translation.y(), 0.0, 0.005);
  EXPECT_GT(r.narrow.unobserved_directions, 0);
}

TEST(HybridIcp, RefiningBeginsByItselfWhereNothingWasRegisteredBefore) {
  FrontendConfig config;
  LocalMap map(MapSizes().voxel_m, config.max_points_per_voxel, MapSizes().spacing_m);
  const Parallel parallel(1);
  map.insert(test::room(1), Pose());
  HybridIcp registration(icp_config(config));
  const Pose guess(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.2, 0.1, 0.0));
  const IcpResult r = registration.refine(map, test::room(2, 1500), guess, 0.5, parallel);
  EXPECT_LT(r.map_from_source.translation.norm(), 0.01);
}

// Bushes, every other one of which the map has where it is not: `off` along x, and seen from `far` m away.
double refined_among_bushes(double off, double far) {
  Cloud right, wrong, source;
  test::Dice dice(4);
  for (int k = 0; k < 16; ++k) {
    const double azimuth = 2.0 * M_PI * k / 16.0;
    const Eigen::Vector3d bush(9.0 * std::cos(azimuth), 9.0 * std::sin(azimuth), 0.0);
    for (int i = 0; i < 300; ++i) {
      const Eigen::Vector3d p = bush + dice.vector(1.0);
      source.push_back(p.cast<float>());
      if (k % 2 == 0) {
        right.push_back(p.cast<float>());
      } else {
        wrong.push_back((p + Eigen::Vector3d(off, 0.0, 0.0)).cast<float>());
      }
    }
  }
  FrontendConfig config;
  LocalMap map(MapSizes().voxel_m, config.max_points_per_voxel, MapSizes().spacing_m);
  map.insert(right, Pose(), Eigen::Vector3d::Zero());
  map.insert(wrong, Pose(), Eigen::Vector3d(0.0, -far, 0.0));
  HybridIcp registration(icp_config(config));
  return registration.refine(map, source, Pose(), 0.3, Parallel(1)).map_from_source.translation.x();
}

TEST(HybridIcp, RefiningTrustsWhatTheMapSawFromAfarLess) {
  constexpr double kOff = 0.1;  // [m]
  const double near = refined_among_bushes(kOff, 10.0), far = refined_among_bushes(kOff, 100.0);
  EXPECT_GT(near, 0.3 * kOff);
  EXPECT_LT(near, 0.7 * kOff);
  EXPECT_GT(far, 0.0);
  EXPECT_LT(far, 0.5 * near);
}

TEST(ResidualScales, NarrowToWhatResidualsAreAndNeverWiden) {
  NormalEquations sums;
  sums.planar.h[0] = sums.planar.h[6] = 1.0;  // weights of 2 in all
  sums.planar.squares = 2.0 * 0.1 * 0.1;
  sums.non_planar.w = 4.0;
  sums.non_planar.squares = 4.0 * 0.2 * 0.2;
  const ResidualScales wide{2.0, 2.0};
  const ResidualScales once = wide.narrowed(sums);
  EXPECT_NEAR(once.planar_m, 0.15, 1e-12);
  EXPECT_NEAR(once.point_m, 0.24, 1e-12);
  const ResidualScales below{0.1, 0.2};
  EXPECT_EQ(below.narrowed(sums).planar_m, 0.1);
  EXPECT_EQ(below.narrowed(sums).point_m, 0.2);
  // No correspondences, or residuals of nearly zero: no narrower than noise.
  EXPECT_EQ(wide.narrowed(NormalEquations()).planar_m, 0.05);
  EXPECT_EQ(wide.narrowed(NormalEquations()).point_m, 0.1);
}

}  // namespace
}  // namespace hp2
