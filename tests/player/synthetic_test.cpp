// Synthetic drives: rays meet solids where geometry says, scans agree with the exact ground truth, loops
// close.
#include <cmath>
#include <unordered_set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "player/scan_source.hpp"
#include "player/synthetic/random.hpp"
#include "player/synthetic/route.hpp"
#include "player/synthetic/synthetic_source.hpp"
#include "player/synthetic/world.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using Eigen::Vector3d;
using test::error_of;
using ::testing::HasSubstr;

TEST(World, RaysMeetSolidsWhereGeometrySays) {
  World world;
  world.add(Box{10, 0, 1, 2, 0, 0, 3, 0.5});
  world.add(Box{0, 20, 2, 1, M_PI / 4, 0, 3, 0.5});  // stands on its edge, as seen from the origin
  world.add(Cylinder{-8, 0, 0.5, 0, 4, 0.6});
  world.add(Crown{0, -12, 5, 2, 0.7});
  world.build();
  const Vector3d eye(0, 0, 1.5);
  EXPECT_NEAR(world.cast(eye, Vector3d::UnitX(), 50).range, 9.0, 1e-9);
  EXPECT_NEAR(world.cast(eye, Vector3d::UnitX(), 50).cos_incidence, 1.0, 1e-9);
  EXPECT_LT(world.cast(eye, Vector3d::UnitX(), 8.9).range, 0.0);
  EXPECT_NEAR(world.cast(eye, -Vector3d::UnitX(), 50).range, 7.5, 1e-9);
  // The nearest edge of the turned box lies half_x * sin 45 + half_y * cos 45 before its centre, off the axis
  // by half their difference: on the axis the ray meets the side of half_y = 1, 1 / cos 45 before the centre.
  EXPECT_NEAR(world.cast(eye, Vector3d::UnitY(), 50).range, 20.0 - std::sqrt(2.0), 1e-9);
  const Vector3d to_crown = (Vector3d(0, -12, 5) - eye).normalized();
  EXPECT_NEAR(world.cast(eye, to_crown, 50).range, (Vector3d(0, -12, 5) - eye).norm() - 2.0, 1e-9);
  EXPECT_TRUE(world.cast(eye, to_crown, 50).leaves);
  EXPECT_NEAR(world.cast(eye, Vector3d(0.6, 0.0, -0.8), 50).range, 1.5 / 0.8, 1e-9);  // the flat ground
  EXPECT_LT(world.cast(eye, Vector3d(1, 0, 0.5).normalized(), 50).range, 0.0);        // over the box: sky
  EXPECT_LT(world.cast(eye, Vector3d::UnitZ(), 50).range, 0.0);
  world.ceiling_m = 3.0;
  EXPECT_NEAR(world.cast(eye, Vector3d::UnitZ(), 50).range, 1.5, 1e-9);
}

TEST(World, GridFindsWhatAFullSearchFinds) {
  // The same solids in one world and each in a world of its own: the nearest hit must be the same.
  Random random(4);
  World all;
  std::vector<World> single(60);
  for (std::size_t i = 0; i < single.size(); ++i) {
    const double x = random.uniform(-40, 40);
    const double y = random.uniform(-40, 40);
    if (i % 3 == 0) {
      const Box box{x,
                    y,
                    random.uniform(0.1, 6),
                    random.uniform(0.1, 6),
                    random.uniform(0, 3),
                    -1,
                    random.uniform(0.5, 9),
                    0.5};
      all.add(box), single[i].add(box);
    } else if (i % 3 == 1) {
      const Cylinder c{x, y, random.uniform(0.05, 3), -1, random.uniform(1, 9), 0.5};
      all.add(c), single[i].add(c);
    } else {
      const Crown c{x, y, random.uniform(1, 6), random.uniform(0.5, 3), 0.5};
      all.add(c), single[i].add(c);
    }
    single[i].build();
  }
  all.build();
  int hits = 0;
  for (int k = 0; k < 5000; ++k) {
    const Vector3d eye(random.uniform(-20, 20), random.uniform(-20, 20), random.uniform(0.2, 5));
    const double azimuth = random.uniform(-M_PI, M_PI);
    const double elevation = random.uniform(-0.5, 0.5);
    const Vector3d ray(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                       std::sin(elevation));
    double nearest = -1.0;
    for (const World& world : single) {
      const double range = world.cast(eye, ray, 70).range;
      if (range >= 0.0 && (nearest < 0.0 || range < nearest)) nearest = range;
    }
    ASSERT_NEAR(all.cast(eye, ray, 70).range, nearest, 1e-9) << "ray " << k;
    hits += nearest >= 0.0;
  }
  EXPECT_GT(hits, 3000);
}

TEST(World, RaysEndOnRollingGround) {
  World world;
  world.ground = {0.5, {0.1, 0.4, 0.8}};
  world.build();
  Random random(5);
  int hits = 0;
  for (int k = 0; k < 2000; ++k) {
    const double x = random.uniform(-100, 100);
    const double y = random.uniform(-100, 100);
    const Vector3d eye(x, y, world.ground.height(x, y) + 1.8);
    const double azimuth = random.uniform(-M_PI, M_PI);
    const double elevation = random.uniform(-1.2, -0.05);
    const Vector3d ray(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                       std::sin(elevation));
    const Hit hit = world.cast(eye, ray, 70);
    if (hit.range < 0.0) continue;
    ++hits;
    const Vector3d p = eye + hit.range * ray;
    EXPECT_NEAR(p.z(), world.ground.height(p.x(), p.y()), 2e-4);
    const double e = 1e-5;  // slopes against differences of heights
    const Vector3d at = world.ground.at(x, y);
    EXPECT_NEAR(at[1], (world.ground.height(x + e, y) - world.ground.height(x - e, y)) / (2 * e), 1e-4);
    EXPECT_NEAR(at[2], (world.ground.height(x, y + e) - world.ground.height(x, y - e)) / (2 * e), 1e-4);
  }
  EXPECT_GT(hits, 1900);
}

TEST(Route, PoseAndSpeedAreContinuous) {
  RouteOptions options;
  options.closed = true;
  options.repeat_m = 30;
  options.weave_m = 0.3;
  Ground ground{0.5, {0.1, 0.2, 0.3}};
  const Route route({{20, 0}, {60, 0}, {60, 40}, {0, 40}, {0, 0}}, options, ground);
  EXPECT_NEAR(route.length(), 200 + 30 - 20, 8.0);  // corners are cut
  Pose before = route.pose_at(0.0);
  Eigen::Vector3d step_before = Eigen::Vector3d::Zero();
  for (double t = 0.01; t < route.duration(); t += 0.01) {
    const Pose now = route.pose_at(t);
    const Eigen::Vector3d step = now.translation - before.translation;
    EXPECT_LT(step.norm(), 0.01 * (options.max_speed + 0.1));
    EXPECT_LT((step - step_before).norm(), t < 0.02 ? 0.02 : 0.0008) << t;  // under 8 m/s^2
    EXPECT_LT(rotation_angle(before.rotation.conjugate() * now.rotation), 0.01 * 1.2);
    EXPECT_GT(t < 0.5 ? 1.0 : (before.rotation.conjugate() * step).x(), 0.0);  // it looks ahead
    before = now;
    step_before = step;
  }
}

TEST(Route, TurnsEvenlyInABend) {
  Ground ground;
  RouteOptions options;
  options.closed = true;
  const Route route({{20, 0}, {60, 0}, {60, 40}, {0, 40}, {0, 0}}, options, ground);
  constexpr double kSweep = 0.1;
  const auto heading = [&](double t) { return route.pose_at(t).rotation * Vector3d::UnitX(); };
  const auto turn = [&](double t) { return heading(t).cross(heading(t + kSweep)).z(); };
  double most = 0.0;
  for (double t = 1.0; t + 2.0 * kSweep < route.duration(); t += 0.03) {
    most = std::max(most, turn(t));
    EXPECT_NEAR(turn(t + kSweep), turn(t), 0.008) << t;  // [rad] a sweep, of up to
  }
  EXPECT_GT(most, 0.05);
}

TEST(Synthetic, EveryCallGivesTheSameScanAndAnotherSeedAnother) {
  const auto a = open_source("synthetic:tiny:7");
  const auto b = open_source("synthetic:tiny:7");
  const auto c = open_source("synthetic:tiny:8");
  EXPECT_EQ(a->size(), 40U);
  EXPECT_EQ(a->info().format, "synthetic");
  b->read(30);
  const Scan first = a->read(12);
  test::expect_same_points(first, b->read(12));
  EXPECT_EQ(first.time, b->read(12).time);
  EXPECT_NE(first.x, c->read(12).x);
  EXPECT_GT(first.size(), 5000U);
  EXPECT_LE(first.size(), 8000U);
  EXPECT_EQ(first.utime, 1'200'000);
  EXPECT_EQ(first.duration_us, 100'000);
}

TEST(Synthetic, UnknownSceneOrSeed) {
  EXPECT_THAT(error_of([] { open_source("synthetic:lop"); }), HasSubstr("Did you mean 'loop'"));
  EXPECT_THAT(error_of([] { open_source("synthetic:"); }), HasSubstr("no synthetic scene"));
  EXPECT_THAT(error_of([] { open_source("synthetic:tiny:x"); }), HasSubstr("seed"));
  EXPECT_THAT(error_of([] { open_source("synthetic:tiny:-1"); }), HasSubstr("seed"));
  for (const auto& [name, text] : synthetic_scenes()) {
    EXPECT_GT(open_source("synthetic:" + name)->size(), 30U) << name;
    EXPECT_FALSE(text.empty());
  }
}

/// Share of `points` with a point of `reference` in the 27 voxels of 0.1 m around them; both in the world.
double agreement(const std::vector<Vector3d>& reference, const std::vector<Vector3d>& points) {
  const auto cell = [](double v) { return static_cast<std::int64_t>(std::floor(v / 0.1)) + (1 << 20); };
  const auto key = [](std::int64_t x, std::int64_t y, std::int64_t z) { return x << 42 | y << 21 | z; };
  std::unordered_set<std::int64_t> voxels;
  for (const Vector3d& p : reference) voxels.insert(key(cell(p.x()), cell(p.y()), cell(p.z())));
  std::size_t n = 0;
  for (const Vector3d& p : points) {
    bool near = false;
    for (int i = 0; i < 27 && !near; ++i)
      near = voxels.count(
                 key(cell(p.x()) + i % 3 - 1, cell(p.y()) + i / 3 % 3 - 1, cell(p.z()) + i / 9 - 1)) > 0;
    n += near;
  }
  return static_cast<double>(n) / static_cast<double>(points.size());
}

/// Points within 12 m in the world, each by the pose at its own instant between two ends of sweeps; or all by
/// the last.
std::vector<Vector3d> in_world(const ScanSource& source, std::size_t i, bool deskew) {
  const Scan scan = source.read(i);
  std::vector<Vector3d> points;
  for (std::size_t k = 0; k < scan.size(); ++k) {
    const Vector3d p(scan.x[k], scan.y[k], scan.z[k]);
    if (p.norm() > 12.0) continue;
    const Pose pose = interpolate(source.ground_truth()[i - 1].pose, source.ground_truth()[i].pose,
                                  deskew ? scan.time[k] : 1.0);
    points.push_back(pose * p);
  }
  return points;
}

TEST(Synthetic, ScansAgreeWithOneAnotherWhenMovedByTheGroundTruth) {
  const auto source = open_source("synthetic:loop");
  for (const std::size_t i : {100U, 400U}) {
    std::vector<Vector3d> reference;
    for (const std::size_t j : {i - 2, i - 1, i + 1, i + 2}) {
      const auto more = in_world(*source, j, true);
      reference.insert(reference.end(), more.begin(), more.end());
    }
    const double deskewed = agreement(reference, in_world(*source, i, true));
    EXPECT_GT(deskewed, 0.85) << i;
    EXPECT_LT(agreement(reference, in_world(*source, i, false)), deskewed - 0.05)
        << i;  // the distortion is real
  }
}

TEST(Synthetic, LoopRepeatsItsStart) {
  const auto source = open_source("synthetic:loop");
  const auto& poses = source->ground_truth();
  ASSERT_EQ(poses.size(), source->size());
  EXPECT_NEAR(poses[0].pose.translation.norm(), 0.0, 1e-9);
  double length = 0.0;
  double repeated = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    EXPECT_EQ(poses[i].utime, static_cast<std::int64_t>(i + 1) * 100'000);
    const double step = (poses[i].pose.translation - poses[i - 1].pose.translation).norm();
    length += step;
    if (length < 300.0) continue;
    for (std::size_t k = 0; k < 150; ++k) {
      if ((poses[i].pose.translation - poses[k].pose.translation).norm() > 1.5) continue;
      EXPECT_LT(rotation_angle(poses[i].pose.rotation.conjugate() * poses[k].pose.rotation), 0.3);
      repeated += step;
      break;
    }
  }
  EXPECT_GT(length, 420.0);
  EXPECT_LT(length, 520.0);
  EXPECT_GT(repeated, 60.0);
}

TEST(Synthetic, ReverseComesBackTheOtherWay) {
  const auto source = open_source("synthetic:reverse");
  const auto& poses = source->ground_truth();
  const Pose last = poses.back().pose;
  EXPECT_LT(last.translation.head<2>().norm(), 6.0);
  EXPECT_GT(rotation_angle(last.rotation), 3.0);
}

}  // namespace
}  // namespace hp2
