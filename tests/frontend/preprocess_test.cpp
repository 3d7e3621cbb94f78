// Range crop and downsampling against a one-pass reference; deskewing of a static world.
#include "frontend/odometry/preprocess.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <set>

#include <gtest/gtest.h>

#include "frontend/odometry/deskew.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using test::Cloud;
using test::Dice;

// Coordinates are multiples of 1/16 m and voxels powers of two, so that both sides compute without rounding.
constexpr double kMapVoxel = 0.5, kSourceVoxel = 2.0, kMin = 2.0, kMax = 50.0;

PreprocessedScan reference(const Scan& scan) {
  using Key = std::array<int, 3>;
  std::set<Key> map_voxels, source_voxels;
  PreprocessedScan out;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const double x = scan.x[i], y = scan.y[i], z = scan.z[i];
    const double range = std::sqrt(x * x + y * y + z * z);
    if (!(range >= kMin && range <= kMax)) {
      ++out.dropped;
      continue;
    }
    const auto key = [&](double edge) {
      return Key{static_cast<int>(std::floor(x / edge)), static_cast<int>(std::floor(y / edge)),
                 static_cast<int>(std::floor(z / edge))};
    };
    if (!map_voxels.insert(key(kMapVoxel)).second) continue;
    if (source_voxels.insert(key(kSourceVoxel)).second) {
      out.source.push_back(static_cast<std::uint32_t>(out.points.size()));
    }
    out.points.emplace_back(scan.x[i], scan.y[i], scan.z[i]);
    out.time.push_back(scan.time[i]);
    out.max_range_m = std::max(out.max_range_m, range);
  }
  return out;
}

Cloud dyadic_cloud(unsigned seed, int n, double size) {
  Dice dice(seed);
  Cloud c;
  for (int i = 0; i < n; ++i) {
    c.push_back((dice.vector(size) * 16.0).array().round().matrix().cast<float>() / 16.0F);
  }
  return c;
}

TEST(Preprocessor, EqualsOnePassInOrderWithAnyNumberOfThreads) {
  Preprocessor one({kMin, kMax, kMapVoxel, kSourceVoxel}), two = one;
  const Parallel parallel1(1), parallel2(2);
  // Many and few points by turns: the tables are reused from scan to scan.
  for (const int n : {90000, 300, 7, 1, 0, 40000, 5000}) {
    Scan scan = test::scan_of(dyadic_cloud(static_cast<unsigned>(n) + 1U, n, n > 50000 ? 32.0 : 12.0), 0);
    if (n > 100) {
      scan.x[10] = std::numeric_limits<float>::quiet_NaN();
      scan.y[20] = std::numeric_limits<float>::infinity();
      scan.z[30] = -1e30F;
      scan.x[40] = kMax, scan.y[40] = scan.z[40] = 0.0F;  // the limits themselves are kept
      scan.x[50] = -kMin, scan.y[50] = scan.z[50] = 0.0F;
    }
    const PreprocessedScan expected = reference(scan);
    PreprocessedScan a, b;
    one.run(scan, true, parallel1, a);
    two.run(scan, true, parallel2, b);
    for (const auto& got : {a, b}) {
      EXPECT_EQ(got.dropped, expected.dropped);
      EXPECT_EQ(got.points, expected.points);
      EXPECT_EQ(got.time, expected.time);
      EXPECT_EQ(got.source, expected.source);
      EXPECT_NEAR(got.max_range_m, expected.max_range_m, 1e-5);
    }
    one.run(scan, false, parallel1, a);
    EXPECT_TRUE(a.time.empty());
    EXPECT_EQ(a.points, expected.points);
  }
}

TEST(Deskew, PutsAStaticWorldBack) {
  Dice dice(5);
  for (int trial = 0; trial < 20; ++trial) {
    Vector6d twist;  // up to 3 m and half a radian a sweep
    twist << dice.vector(3.0), dice.vector(0.5);
    const Deskew deskew(twist);
    const Pose start_from_end = se3_exp(twist);
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d in_start = dice.vector(60.0);
      const double s = dice.uniform(0, 1);
      const Eigen::Vector3d seen = se3_exp(s * twist).inverse() * in_start;
      const Eigen::Vector3d expected = start_from_end.inverse() * in_start;
      const Eigen::Vector3f got = deskew(seen.cast<float>(), static_cast<float>(s));
      ASSERT_LT((got.cast<double>() - expected).norm(), 1e-3);
    }
  }
}

TEST(Deskew, LeavesTheSweepsEndAloneAndClampsTime) {
  Vector6d twist;
  twist << 1.0, -0.5, 0.2, 0.1, 0.2, -0.3;
  const Deskew deskew(twist);
  const Eigen::Vector3f p(20.0F, -7.0F, 3.0F);
  EXPECT_LT((deskew(p, 1.0F) - p).norm(), 1e-5F);
  EXPECT_EQ(deskew(p, 1.7F), deskew(p, 1.0F));
  EXPECT_EQ(deskew(p, -0.2F), deskew(p, 0.0F));
  EXPECT_TRUE(deskew(p, std::numeric_limits<float>::quiet_NaN()).allFinite());
  EXPECT_GT((deskew(p, 0.0F) - p).norm(), 0.5F);
  EXPECT_LT((Deskew(Vector6d::Zero())(p, 0.3F) - p).norm(), 1e-6F);
}

}  // namespace
}  // namespace hp2
