#include "backend/closures/closure_verifier.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backend/closures/ambiguity.hpp"
#include "backend_fixtures.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;
using testing::street_scene;

// A submap of points given in its own frame, with a path of 20 m along x of `submap_from_scene` at sensor
// height.
CheckedSubmap checked(std::int64_t id, std::vector<Eigen::Vector3f> points, const Pose& submap_from_scene) {
  Submap m;
  m.id = id;
  m.points = std::move(points);
  for (int i = 0; i <= 10; ++i) {
    ScanPose s;
    s.submap_from_sensor = Pose({1, 0, 0, 0}, submap_from_scene * Eigen::Vector3d(2.0 * i - 10.0, 0.0, 1.8));
    m.scans.push_back(s);
  }
  std::vector<Eigen::Vector3d> path;
  for (const auto& s : m.scans) path.push_back(s.submap_from_sensor.translation);
  return {m, align_ground(m.points, path)};
}

ClosureRecord verify(const CheckedSubmap& a, const CheckedSubmap& b, const Pose& guess, const Pose& predicted,
                     double bound_m) {
  return verify_closure(a, b, guess, {predicted, bound_m, 0.4}, 25.0, 5.0, 0.26, true, {});
}

// Ground and two walls; with `spacing` pillars stand along them at that distance from one another.
std::vector<Eigen::Vector3f> canyon(unsigned seed, double spacing, const Pose& out_from_scene) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> jitter(-0.2, 0.2);
  std::vector<Eigen::Vector3f> points;
  const auto put = [&](double x, double y, double z) {
    points.push_back((out_from_scene * Eigen::Vector3d(x, y, z)).cast<float>());
  };
  for (double x = -60.0; x < 60.0; x += 0.4) {
    for (double y = -6.0; y < 6.0; y += 0.5) put(x + jitter(rng), y + jitter(rng), 0.0);
    for (double z = 0.2; z < 5.0; z += 0.4) {
      for (const double side : {-6.0, 6.0}) put(x + jitter(rng), side, z + jitter(rng));
    }
  }
  for (double x = -60.0; spacing > 0.0 && x < 60.0; x += spacing) {
    for (double d = 0.0; d < 1.5; d += 0.3) {
      for (double z = 0.2; z < 5.0; z += 0.3) {
        for (const double side : {-1.0, 1.0}) put(x, side * (6.0 - d), z + jitter(rng));
      }
    }
  }
  return points;
}

const Pose kHere;
const Pose kBack(so3_exp({0.01, -0.02, 2.9}), {6.0, 2.0, 0.3});  // seen in the opposite direction

TEST(ClosureVerifier, AcceptsAPlaceSeenAgainInTheOppositeDirection) {
  const auto a = checked(0, street_scene(1, 0.02, kHere), kHere);
  const auto b = checked(9, street_scene(2, 0.02, kBack), kBack);
  const Pose truth = kBack.inverse();
  const Pose guess = truth * se3_exp((Vector6d() << 1.0, -0.8, 0.2, 0.01, 0.01, 0.06).finished());
  const auto c = verify(a, b, guess, truth, 20.0);
  EXPECT_TRUE(c.accepted) << c.reason;
  EXPECT_LT((c.from_from_to.translation - truth.translation).norm(), 0.1);
  EXPECT_LT(rotation_angle(c.from_from_to.rotation.conjugate() * truth.rotation), 0.01);
  EXPECT_GT(c.overlap, 0.7);
  EXPECT_EQ(c.from_submap, 0);
  EXPECT_EQ(c.to_submap, 9);
  // What the closure claims to know: some centimetres, and no direction for nothing.
  const Matrix6d covariance = c.information.inverse();
  EXPECT_GT(std::sqrt(covariance.diagonal().head<3>().minCoeff()), 0.03);
  EXPECT_LT(std::sqrt(covariance.diagonal().head<3>().maxCoeff()), 0.3);
}

// The scene seen from `submap_from_scene` by an odometry that erred half way: what lies ahead is off by
// `bend`.
std::vector<Eigen::Vector3f> bent_scene(unsigned seed, const Pose& bend) {
  auto points = street_scene(seed, 0.02, kHere);
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a.x() < b.x(); });
  for (std::size_t i = points.size() / 2; i < points.size(); ++i) {
    points[i] = (bend * points[i].cast<double>()).cast<float>();
  }
  return points;
}

TEST(ClosureVerifier, ABentSubmapLiesHalfWayOrNotAtAll) {
  const auto straight = street_scene(1, 0.02, kHere);
  const Pose little = se3_exp((Vector6d() << 0.1, 0.3, 0.0, 0.0, 0.0, 0.03).finished());
  const Pose much = se3_exp((Vector6d() << 0.2, 0.8, 0.0, 0.0, 0.0, 0.12).finished());
  const Matrix6d certain =
      verify(checked(0, straight, kHere), checked(9, bent_scene(2, kHere), kHere), kHere, kHere, 20.0)
          .information;
  // Whichever of the two it is.
  for (const bool newer : {true, false}) {
    const auto verdict = [&](const Pose& bend) {
      const auto bent = bent_scene(2, bend);
      return verify(checked(0, newer ? straight : bent, kHere), checked(9, newer ? bent : straight, kHere),
                    kHere, kHere, 20.0);
    };
    const auto c = verdict(little);
    EXPECT_TRUE(c.accepted) << c.reason;
    // One half would have it at the identity, the other one at the bend.
    const Pose whole = newer ? c.from_from_to : c.from_from_to.inverse();
    EXPECT_NEAR(so3_log(whole.rotation).z(), -0.015, 0.005);
    EXPECT_LT(c.information(5, 5), 0.2 * certain(5, 5));
    const auto refused = verdict(much);
    EXPECT_FALSE(refused.accepted);
    EXPECT_THAT(refused.reason, HasSubstr(newer ? "newer submap is bent" : "older submap is bent"));
  }
}

TEST(ClosureVerifier, RefusesWhatOdometryContradicts) {
  const auto a = checked(0, street_scene(1, 0.02, kHere), kHere);
  const auto b = checked(9, street_scene(2, 0.02, kBack), kBack);
  const Pose truth = kBack.inverse();
  Pose elsewhere = truth;
  elsewhere.translation.x() += 12.0;
  const auto c = verify(a, b, truth, elsewhere, 8.0);
  EXPECT_FALSE(c.accepted);
  EXPECT_THAT(c.reason, HasSubstr("from where odometry puts it"));
  EXPECT_TRUE(c.information.isZero());
}

TEST(ClosureVerifier, RefusesAnotherPlace) {
  const auto a = checked(0, street_scene(1, 0.02, kHere), kHere);
  const auto b = checked(9, canyon(2, 0.0, kHere), kHere);
  EXPECT_FALSE(verify(a, b, kHere, kHere, 20.0).accepted);
  const auto nothing = checked(9, {}, kHere);
  EXPECT_FALSE(verify(a, nothing, kHere, kHere, 20.0).accepted);
  EXPECT_FALSE(verify(nothing, a, kHere, kHere, 20.0).accepted);
}

TEST(ClosureVerifier, RefusesATunnelWhoseDirectionNothingFixes) {
  const auto a = checked(0, canyon(1, 0.0, kHere), kHere);
  const auto b = checked(9, canyon(2, 0.0, kHere), kHere);
  const auto c = verify(a, b, kHere, kHere, 20.0);
  EXPECT_FALSE(c.accepted);
  EXPECT_THAT(c.reason,
              ::testing::AnyOf(HasSubstr("one direction is not fixed"), HasSubstr("repeated structure")));
}

TEST(ClosureVerifier, RefusesRepeatedStructureUnlessOdometryTellsItApart) {
  const auto a = checked(0, canyon(1, 8.0, kHere), kHere);
  const auto b = checked(9, canyon(2, 8.0, kHere), kHere);
  const auto wide = verify(a, b, kHere, kHere, 20.0);
  EXPECT_FALSE(wide.accepted);
  EXPECT_THAT(wide.reason, HasSubstr("repeated structure"));
  const auto narrow = verify(a, b, kHere, kHere, 1.5);
  EXPECT_TRUE(narrow.accepted) << narrow.reason;
}

TEST(Ambiguity, APoseThatOdometrySpeaksAgainstIsLessOfARival) {
  const auto a = checked(0, canyon(1, 8.0, kHere), kHere);
  const auto b = checked(9, canyon(2, 8.0, kHere), kHere);
  // The pillars repeat every 8 m. Whatever odometry says of it, the rival is a tenth better or worse for it
  // at most.
  const double far = ambiguity(a, b, kHere, {kHere, 9.0, 0.4}),
               near = ambiguity(a, b, kHere, {kHere, 1000.0, 0.4});
  EXPECT_LT(far, near);
  EXPECT_GT(far, near - 0.1);
  EXPECT_GT(near, 0.9);
  EXPECT_LE(ambiguity(a, b, kHere, {kHere, 1.5, 0.4}), 0.0);  // out of its reach
}

}  // namespace
}  // namespace hp2
