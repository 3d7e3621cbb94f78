// Both sides of thin things: what is seen ahead is seen from behind once the sensor has passed it.
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "common/byte_io.hpp"
#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
using test::Cloud;

constexpr double kThick = 0.12;  // [m]
const Vector3d kAhead(20.0, 0.0, 0.0);

// Upright boards across x, one face of each: a point every 0.1 m.
void add_board(Cloud& cloud, double x, double y) {
  for (int i = -10; i <= 10; ++i) {
    for (int k = -10; k <= 10; ++k) cloud.emplace_back(Vector3d(x, y + 0.1 * i, 0.1 * k).cast<float>());
  }
}

Cloud moved(Cloud cloud, const Vector3d& by) {
  for (auto& p : cloud) p += by.cast<float>();
  return cloud;
}

std::vector<std::int32_t> voxels_of(const LocalMap& map, const Cloud& near) {
  std::vector<std::int32_t> out;
  for (const auto& p : near) {
    const NearestPoint n = map.nearest(map.locate(p.cast<double>()));
    if (n.voxel >= 0) out.push_back(n.voxel);
  }
  return out;
}

TEST(LocalMapSides, PointsRememberFromWhereTheyWereSeen) {
  test::Dice dice(1);
  LocalMap map(0.8, 5, 0.1);
  const Vector3d sensor(4.0, -2.0, 1.0);
  Cloud cloud;
  for (int i = 0; i < 500; ++i) cloud.push_back(dice.vector(3.0).cast<float>());
  map.insert(cloud, Pose(), sensor);
  std::size_t points = 0;
  for (const std::int32_t v : voxels_of(map, cloud)) {
    const Vector3f view = map.view(v, 0);
    const Vector3d expected = (sensor - map.point(v, 0)).normalized();
    EXPECT_GT(view.cast<double>().normalized().dot(expected), std::cos(0.01));
    EXPECT_NEAR(view.norm(), 1.0F, 0.01F);
    EXPECT_NEAR(map.view_distance_m(v, 0), (sensor - map.point(v, 0)).norm(), 0.51);
    ++points;
  }
  EXPECT_GT(points, 100U);
  LocalMap unknown(0.8, 5, 0.1);
  unknown.insert(cloud, Pose());
  for (const std::int32_t v : voxels_of(unknown, cloud)) {
    EXPECT_EQ(unknown.view(v, 0), Vector3f::Zero());
    EXPECT_EQ(unknown.view_distance_m(v, 0), 0.0F);
  }
}

TEST(LocalMapSides, DistancesOfViewsStayWithinWhatIsKept) {
  LocalMap map(0.8, 5, 0.1);
  const Cloud points = {{0.1F, 0.0F, 0.0F}, {300.0F, 0.0F, 0.0F}};
  map.insert(points, Pose(), Vector3d::Zero());
  const std::vector<std::int32_t> voxels = voxels_of(map, points);
  ASSERT_EQ(voxels.size(), 2U);
  EXPECT_EQ(map.view_distance_m(voxels[0], 0), 1.0F);  // known, if near
  EXPECT_EQ(map.view_distance_m(voxels[1], 0), 127.0F);
}

TEST(LocalMapSides, OnlyAViewFromAcrossIsAnotherSide) {
  const Vector3f n = Vector3f::UnitX();
  EXPECT_TRUE(LocalMap::other_side(n, {-1, 0, 0}, {1, 0, 0}));
  EXPECT_TRUE(LocalMap::other_side(-n, {-1, 0, 0}, {0.6F, 0.8F, 0}));
  EXPECT_FALSE(LocalMap::other_side(n, {-1, 0, 0}, {-0.6F, 0.8F, 0}));
  EXPECT_FALSE(LocalMap::other_side(n, {-1, 0, 0}, {0.05F, 1, 0}));  // along it
  EXPECT_FALSE(LocalMap::other_side(n, {-1, 0, 0}, Vector3f::Zero()));
}

TEST(LocalMapSides, ABackTakesItsPlaceBesideAFront) {
  LocalMap map(0.8, 5, 0.3);
  Cloud front, back;
  add_board(front, 10.0, 0.0);
  add_board(back, 10.0 + kThick, 0.0);
  map.insert(front, Pose(), Vector3d::Zero());
  const NearestPoint at = map.nearest(map.locate(back[220].cast<double>()));
  const Vector3f query =
      (back[220].cast<double>() - map.voxel_coordinates(at.voxel).cast<double>() * 0.8).cast<float>();
  EXPECT_EQ(map.nearest_on_side(query, at.voxel, Vector3f::UnitX(), {1, 0, 0}, 1.0F).voxel, -1);
  EXPECT_EQ(map.nearest_on_side(query, at.voxel, Vector3f::UnitX(), {-1, 0, 0}, 1.0F).voxel, at.voxel);

  for (const std::int32_t v : voxels_of(map, front)) map.update_planarity(v);
  const std::size_t before = map.point_count();
  for (const auto& p : back) map.insert_other_side(p.cast<double>(), Vector3f::UnitX(), kAhead);
  const NearestPoint other = map.nearest_on_side(query, at.voxel, Vector3f::UnitX(), {1, 0, 0}, 1.0F);
  ASSERT_GE(other.voxel, 0);
  EXPECT_NEAR(map.point(other.voxel, other.slot).x(), 10.0 + kThick, 1e-5);
  EXPECT_LT(other.distance_m, 0.5F);
  EXPECT_GE(map.nearest_on_side(query, at.voxel, Vector3f::UnitX(), {-1, 0, 0}, 1.0F).voxel, 0);
  EXPECT_GT(map.point_count(), before);  // there was room for some, others took a front's place
  // Sums and caches follow.
  for (const std::int32_t v : voxels_of(map, back)) {
    Moments expected;
    map.for_each_point([&](const Vector3d& p) {
      const Eigen::Vector3i away = map.locate(p).voxel - map.voxel_coordinates(v);
      if (away.cwiseAbs().maxCoeff() <= 1) expected.add(p - map.voxel_coordinates(v).cast<double>() * 0.8);
    });
    const Moments sums = map.neighbourhood_moments(v);
    EXPECT_EQ(sums.n, expected.n);
    EXPECT_LT((sums.covariance() - expected.covariance()).norm(), 1e-6);
    EXPECT_TRUE(map.planarity_stale(v));
  }
  // And a second time there is nothing to add.
  const std::size_t after = map.point_count();
  for (const auto& p : back) map.insert_other_side(p.cast<double>(), Vector3f::UnitX(), kAhead);
  EXPECT_EQ(map.point_count(), after);
}

TEST(LocalMapSides, ViewsTurnWithTheMap) {
  LocalMap map(0.8, 5, 0.3);
  Cloud front;
  add_board(front, 10.0, 0.0);
  map.insert(front, Pose(), Vector3d::Zero());
  const Pose by(Eigen::Quaterniond(Eigen::AngleAxisd(M_PI_2, Vector3d::UnitZ())), Vector3d(3.0, 0.0, 0.0));
  map.move(by);
  ASSERT_GT(map.point_count(), 20U);
  map.for_each_point([&](const Vector3d& p) { EXPECT_NEAR(p.y(), 10.0, 1e-5); });
  const NearestPoint n = map.nearest(map.locate(Vector3d(3.0, 10.0, 0.0)));
  ASSERT_GE(n.voxel, 0);
  EXPECT_LT((map.view(n.voxel, n.slot) - Vector3f(0, -1, 0)).norm(), 0.15F);
  EXPECT_EQ(map.view_distance_m(n.voxel, n.slot), 10.0F);
}

TEST(LocalMapSides, SaveAndLoadKeepTheViews) {
  LocalMap map(0.8, 5, 0.3), copy(0.8, 5, 0.3);
  Cloud front;
  add_board(front, 10.0, 0.0);
  map.insert(front, Pose(), Vector3d::Zero());
  map.insert_other_side(Vector3d(10.0 + kThick, 0.0, 0.0), Vector3f::UnitX(), kAhead);
  std::vector<std::uint8_t> bytes, again;
  ByteWriter out(bytes), out_again(again);
  map.save(out);
  ByteReader in(bytes.data(), bytes.data() + bytes.size(), "map");
  copy.load(in);
  EXPECT_EQ(in.left(), 0U);
  copy.save(out_again);
  EXPECT_EQ(bytes, again);
  const NearestPoint n = copy.nearest(copy.locate(Vector3d(10.0, 0.9, 0.0)));
  ASSERT_GE(n.voxel, 0);
  EXPECT_LT((copy.view(n.voxel, n.slot) - Vector3f(-1, 0, 0)).norm(), 0.15F);
  EXPECT_EQ(copy.view_distance_m(n.voxel, n.slot), 10.0F);
}

// Boards on both sides of the way: those ahead show the face that the map knows, those passed their backs.
TEST(LocalMapSides, BacksDoNotHoldTheSensorBack) {
  Cloud world, passed;
  for (const double y : {-4.0, 4.0}) {
    for (const double x : {6.0, 9.0, 12.0}) {
      add_board(world, x, y);
      add_board(passed, x + kThick, y);
    }
    for (const double x : {25.0, 28.0, 31.0}) {
      add_board(world, x, y);
      add_board(passed, x, y);
    }
  }
  for (int i = -40; i <= 160; ++i) {  // the ground, and a wall along the way
    for (int k = -20; k <= 20; ++k) {
      for (Cloud* cloud : {&world, &passed}) {
        cloud->emplace_back(0.25F * static_cast<float>(i), 0.25F * static_cast<float>(k), -1.5F);
        if (k > -6 && k < 6)
          cloud->emplace_back(0.25F * static_cast<float>(i), 8.0F, 0.25F * static_cast<float>(k));
      }
    }
  }
  const Pose truth(Eigen::Quaterniond::Identity(), kAhead);
  const Cloud source = moved(passed, -kAhead);
  const Pose guess(truth.rotation, truth.translation + Vector3d(0.03, 0.02, -0.02));
  const auto error_along = [](const IcpResult& r) { return r.map_from_source.translation.x() - kAhead.x(); };
  for (const bool two_sides : {true, false}) {
    LocalMap map(0.8, 5, 0.3);
    map.insert(world, Pose(), Vector3d::Zero());
    IcpConfig config;
    config.two_sides = two_sides;
    if (!two_sides) config.mode = IcpMode::kPointToPlane;
    HybridIcp icp(config);
    const IcpResult result = icp.align(map, source, guess, 0.1, Parallel(1));
    const double error = error_along(result);
    std::vector<std::pair<std::uint32_t, Vector3f>> turned;
    icp.turned_points(IcpResult(), turned);
    EXPECT_TRUE(turned.empty());  // not the outcome of the last call
    icp.turned_points(result, turned);
    if (two_sides) {
      EXPECT_LT(std::abs(error), 0.005);
      EXPECT_GT(turned.size(), 1000U);
      for (const auto& [i, normal] : turned) EXPECT_LT(source[i].x(), -6.0F);
      // Once the map has the backs they are registered as well.
      for (const auto& [i, normal] : turned)
        map.insert_other_side(truth * source[i].cast<double>(), normal, kAhead);
      EXPECT_LT(std::abs(error_along(icp.align(map, source, guess, 0.1, Parallel(1)))), 0.005);
    } else {
      EXPECT_LT(error, -0.02);  // what it is about
      EXPECT_TRUE(turned.empty());
    }
  }
}

}  // namespace
}  // namespace hp2
