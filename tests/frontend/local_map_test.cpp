// The local map against a slow one that keeps every point in a std::map of voxels.
#include "common/registration/local_map.hpp"

#include <algorithm>
#include <cstring>
#include <map>
#include <set>
#include <utility>

#include <gtest/gtest.h>

#include "tests/frontend/made_up_clouds.hpp"
#include "tests/frontend/slow_map.hpp"

namespace hp2 {
namespace {

using Eigen::Vector3d;
using test::Cloud;
using test::Dice;
using test::Key;
using test::Twins;

std::vector<Vector3d> sorted(std::vector<Vector3d> points) {
  std::sort(points.begin(), points.end(), [](const Vector3d& a, const Vector3d& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  });
  return points;
}

std::vector<Vector3d> points_of(const LocalMap& map) {
  std::vector<Vector3d> out;
  map.for_each_point([&](const Vector3d& p) { out.push_back(p); });
  return out;
}

// Voxel indices of the map, found through its points.
std::set<std::int32_t> voxels_of(const LocalMap& map) {
  std::set<std::int32_t> out;
  for (const auto& p : points_of(map)) out.insert(map.nearest(map.locate(p)).voxel);
  return out;
}

Key key_of(const Voxel3i& v) { return {v.x(), v.y(), v.z()}; }

Eigen::Matrix3d covariance_of(const std::vector<Vector3d>& points) {
  Vector3d mean = Vector3d::Zero();
  for (const auto& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  Eigen::Matrix3d c = Eigen::Matrix3d::Zero();
  for (const auto& p : points) c += (p - mean) * (p - mean).transpose();
  return c / static_cast<double>(points.size());
}

Cloud random_cloud(Dice& dice, int n, double size) {
  Cloud c;
  for (int i = 0; i < n; ++i) c.push_back(dice.vector(size).cast<float>());
  return c;
}

void expect_same_points(const Twins& t) {
  const auto a = sorted(points_of(t.map)), b = sorted(t.slow.all());
  ASSERT_EQ(a.size(), b.size());
  EXPECT_EQ(t.map.point_count(), b.size());
  EXPECT_EQ(t.map.voxel_count(), t.slow.voxels.size());
  EXPECT_EQ(t.map.empty(), b.empty());
  // The map takes points in floats, so that those of nearly equal x may come in another order. Each of them
  // has one of the slow map's to itself.
  constexpr double kSame = 3e-6;
  std::vector<bool> taken(b.size(), false);
  for (const Vector3d& p : a) {
    const auto from = std::lower_bound(b.begin(), b.end(), p.x() - kSame,
                                       [](const Vector3d& q, double x) { return q.x() < x; });
    double nearest = kSame;
    std::ptrdiff_t match = -1;
    for (auto q = from; q != b.end() && q->x() <= p.x() + kSame; ++q) {
      const double d = (*q - p).norm();
      if (d >= nearest || taken[static_cast<std::size_t>(q - b.begin())]) continue;
      nearest = d;
      match = q - b.begin();
    }
    ASSERT_GE(match, 0);
    taken[static_cast<std::size_t>(match)] = true;
  }
}

void expect_same_covariances(const Twins& t) {
  const auto voxels = voxels_of(t.map);
  ASSERT_EQ(voxels.size(), t.map.voxel_count());
  for (const std::int32_t v : voxels) {
    const Moments m = t.map.neighbourhood_moments(v);
    // The map's own points (offsets in float), so that only the way of summing differs.
    std::vector<Vector3d> points;
    const Vector3d corner = t.map.voxel_coordinates(v).cast<double>() * t.map.voxel_size_m();
    for (const std::int32_t o : voxels) {
      const Voxel3i d = t.map.voxel_coordinates(o) - t.map.voxel_coordinates(v);
      if (d.cwiseAbs().maxCoeff() > 1) continue;
      const std::size_t count = t.slow.voxels.at(key_of(t.map.voxel_coordinates(o))).size();
      for (std::size_t s = 0; s < count; ++s) {
        points.emplace_back(d.cast<double>() * t.map.voxel_size_m() +
                            t.map.point_offset(o, static_cast<std::int32_t>(s)).cast<double>());
      }
    }
    ASSERT_EQ(m.n, static_cast<double>(points.size()));
    const Eigen::Matrix3d expected = covariance_of(points);
    EXPECT_LE((m.covariance() - expected).norm(), 1e-9 * expected.norm() + 1e-14);
    // And the slow map's points, which share nothing with the map but the input.
    const auto around = t.slow.around(key_of(t.map.voxel_coordinates(v)));
    ASSERT_EQ(around.size(), points.size());
    EXPECT_LE((m.covariance() - covariance_of(around)).norm(), 1e-5 * expected.norm() + 1e-9);
    Vector3d mean = Vector3d::Zero();
    for (const auto& p : around) mean += p / static_cast<double>(around.size());
    EXPECT_LT((corner + m.mean() - mean).norm(), 1e-6);
  }
}

TEST(LocalMap, KeepsThePointsThatASlowMapKeeps) {
  Dice dice(1);
  for (const double spacing : {0.0, 0.3}) {
    Twins t(0.7, 4, spacing);
    for (int i = 0; i < 4; ++i) t.insert(random_cloud(dice, 1500, 4.0), dice.pose(2.0, 3.0));
    expect_same_points(t);
  }
}

TEST(LocalMap, CovariancesFromMomentSumsEqualThosePointByPoint) {
  Dice dice(2);
  for (const Vector3d& far : {Vector3d(0, 0, 0), Vector3d(1e5, -1e5, 300.0)}) {
    Twins t(0.6, 5, 0.1);
    Pose pose = dice.pose(1.0, 3.0);
    pose.translation += far;
    t.insert(random_cloud(dice, 800, 3.0), pose);
    expect_same_covariances(t);
    pose.translation += Vector3d(4.0, 1.0, 0.0);
    t.insert(random_cloud(dice, 800, 3.0), pose);
    expect_same_covariances(t);
    // Blocks go, others come in their place in memory.
    t.remove_far(pose.translation, 4.0);
    ASSERT_FALSE(t.map.empty());
    expect_same_points(t);
    expect_same_covariances(t);
    pose.translation += Vector3d(-4.0, 1.0, 1.0);
    t.insert(random_cloud(dice, 800, 3.0), pose);
    expect_same_points(t);
    expect_same_covariances(t);
  }
}

TEST(LocalMap, CachedPlanarityIsStaleExactlyWhereTheNeighbourhoodChanged) {
  Dice dice(3);
  LocalMap map(0.6, 6, 0.0);
  map.insert(random_cloud(dice, 3000, 3.0), Pose());
  std::map<Key, double> before;  // points in the neighbourhood at the last update
  const auto update_all = [&] {
    before.clear();
    for (const std::int32_t v : voxels_of(map)) {
      map.update_planarity(v);
      before[key_of(map.voxel_coordinates(v))] = map.neighbourhood_moments(v).n;
    }
  };
  const auto check = [&] {
    std::size_t stale = 0;
    for (const std::int32_t v : voxels_of(map)) {
      const auto it = before.find(key_of(map.voxel_coordinates(v)));
      const Moments now = map.neighbourhood_moments(v);
      // Only insertions or only removals happen between two checks: the count tells whether anything changed.
      const bool changed = it == before.end() || it->second != now.n;
      EXPECT_EQ(map.planarity_stale(v), changed);
      stale += map.planarity_stale(v) ? 1U : 0U;
      if (map.planarity_stale(v)) map.update_planarity(v);
      const Planarity fresh = analyse(now);
      EXPECT_EQ(map.planarity(v).n, fresh.n);
      EXPECT_EQ(map.planarity(v).score, fresh.score);
      EXPECT_EQ(map.planarity(v).normal, fresh.normal);
    }
    return stale;
  };
  update_all();
  EXPECT_EQ(check(), 0U);
  map.insert(random_cloud(dice, 40, 3.0), Pose());
  EXPECT_GT(check(), 0U);
  update_all();
  map.remove_far(Vector3d(-2, 0, 0), 3.5);
  EXPECT_GT(check(), 0U);
  update_all();
  map.insert(random_cloud(dice, 200, 3.0), Pose());
  EXPECT_GT(check(), 0U);
}

// nearest() and its lower bound against all points of the slow map.
void check_nearest(const Twins& t, Dice& dice, const Vector3d& centre, double reach, int queries) {
  const auto all = t.slow.all();
  int empty_voxels = 0, found = 0;
  LocalMap::Cursor cursor;
  for (int i = 0; i < queries; ++i) {
    const Vector3d q = centre + dice.vector(reach);
    const VoxelPoint at = t.map.locate(q);
    ASSERT_EQ(key_of(at.voxel), t.slow.key(q));
    const NearestPoint n = t.map.nearest(at, cursor);
    const auto near = t.slow.around(t.slow.key(q));
    empty_voxels += t.slow.voxels.count(t.slow.key(q)) == 0 ? 1 : 0;
    double best = std::numeric_limits<double>::infinity();
    for (const auto& p : near) best = std::min(best, (p - q).norm());
    if (near.empty()) {
      EXPECT_EQ(n.voxel, -1);
    } else {
      ++found;
      ASSERT_GE(n.voxel, 0);
      EXPECT_NEAR(static_cast<double>(n.distance_m), best, 1e-5);
      EXPECT_NEAR((t.map.point(n.voxel, n.slot) - q).norm(), best, 1e-5);
    }
    // The bound holds for every other point of the map, inside of the 27 voxels or not.
    const Vector3d named = n.voxel >= 0 ? t.map.point(n.voxel, n.slot) : Vector3d::Constant(1e9);
    for (const auto& p : all) {
      if ((p - named).norm() < 1e-6) continue;
      ASSERT_LE(static_cast<double>(n.other_distance_m), (p - q).norm() + 1e-5);
    }
  }
  EXPECT_GT(empty_voxels, queries / 50);
  EXPECT_GT(found, queries / 4);
}

TEST(LocalMap, NearestEqualsBruteForceAndItsBoundHolds) {
  Dice dice(4);
  for (const Vector3d& far : {Vector3d(0, 0, 0), Vector3d(-1e5, 1e5, -1e5)}) {
    for (const auto& [n, points_per_voxel] : {std::pair(60, 3), std::pair(600, 3), std::pair(600, 8)}) {
      Twins t(0.8, points_per_voxel, 0.2);
      t.insert(random_cloud(dice, n, 3.0), Pose(Eigen::Quaterniond::Identity(), far));
      check_nearest(t, dice, far, 4.0, 300);
      t.remove_far(far, 2.5);
      t.insert(random_cloud(dice, n / 2, 3.0), Pose(Eigen::Quaterniond::Identity(), far));
      check_nearest(t, dice, far, 4.0, 300);
    }
  }
}

TEST(LocalMap, NothingIsNearInAnEmptyMap) {
  LocalMap map(1.0, 3, 0.0);
  EXPECT_TRUE(map.empty());
  EXPECT_EQ(map.nearest(map.locate(Vector3d(-3.2, 0.1, 7.0))).voxel, -1);
  map.insert({Eigen::Vector3f(0.5F, 0.5F, 0.5F)}, Pose());
  map.remove_far(Vector3d(100, 0, 0), 10.0);
  EXPECT_TRUE(map.empty());
  EXPECT_EQ(map.nearest(map.locate(Vector3d(0.5, 0.5, 0.5))).voxel, -1);
}

TEST(LocalMap, SaveAndLoadGiveTheSameAnswers) {
  Dice dice(5);
  LocalMap map(0.6, 3, 0.1);
  map.insert(random_cloud(dice, 2000, 3.0), Pose());
  map.remove_far(Vector3d(-2, 0, 0), 4.0);
  std::vector<std::uint8_t> bytes;
  ByteWriter out(bytes);
  map.save(out);
  LocalMap copy(0.6, 3, 0.1);
  ByteReader in(bytes.data(), bytes.data() + bytes.size(), "map");
  copy.load(in);
  EXPECT_EQ(in.left(), 0U);
  EXPECT_EQ(copy.point_count(), map.point_count());
  for (int i = 0; i < 500; ++i) {
    const VoxelPoint at = map.locate(dice.vector(3.5));
    const NearestPoint a = map.nearest(at), b = copy.nearest(at);
    ASSERT_EQ(a.distance_m, b.distance_m);
    ASSERT_EQ(a.voxel < 0, b.voxel < 0);
    if (a.voxel < 0) continue;
    EXPECT_EQ(map.point(a.voxel, a.slot), copy.point(b.voxel, b.slot));
    EXPECT_EQ(map.neighbourhood_moments(a.voxel).covariance(),
              copy.neighbourhood_moments(b.voxel).covariance());
  }
}

TEST(LocalMap, OfVoxelsFartherThanTheirNumbersReachIsNotLoaded) {
  // Their block would be found under the number of another one.
  LocalMap map(1.0, 3, 0.0);
  map.insert({Eigen::Vector3f(0.5F, 0.5F, 0.5F)}, Pose());
  std::vector<std::uint8_t> bytes;
  ByteWriter out(bytes);
  map.save(out);
  constexpr std::size_t kFirstVoxel = sizeof(std::uint64_t);
  const auto load_with_x = [&](std::int32_t x) {
    std::memcpy(bytes.data() + kFirstVoxel, &x, sizeof x);
    ByteReader in(bytes.data(), bytes.data() + bytes.size(), "map");
    LocalMap copy(1.0, 3, 0.0);
    copy.load(in);
    return copy.point_count();
  };
  EXPECT_EQ(load_with_x(LocalMap::kReach - 1), 1U);
  EXPECT_EQ(load_with_x(1 - LocalMap::kReach), 1U);
  for (const std::int32_t x : {LocalMap::kReach, -LocalMap::kReach, 1 << 30, -(1 << 30)})
    EXPECT_THROW(load_with_x(x), Error);
}

}  // namespace
}  // namespace hp2
