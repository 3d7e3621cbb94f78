#include "common/evaluation/metrics.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include <gtest/gtest.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

// A drive of constant step [m] and yaw rate [rad a pose], with some climbing.
Trajectory drive(std::size_t n, double step, double yaw_rate) {
  std::vector<Pose> poses{Pose()};
  Vector6d motion;
  motion << step, 0, 0.01 * step, 0, 0, yaw_rate;
  while (poses.size() < n) poses.push_back(poses.back() * se3_exp(motion));
  return make_trajectory(poses);
}

Eigen::Matrix4d matrix(const Pose& pose) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topRows<3>() = pose.matrix();
  return m;
}

TEST(Statistics, OfAHandMadeList) {
  const ErrorStatistics s = statistics({1, 2, 3, 6});
  EXPECT_DOUBLE_EQ(s.mean, 3.0);
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_DOUBLE_EQ(s.sse, 50.0);
  EXPECT_DOUBLE_EQ(s.rmse, std::sqrt(12.5));
  EXPECT_DOUBLE_EQ(s.std, std::sqrt(3.5));
  EXPECT_DOUBLE_EQ(s.min, 1.0);
  EXPECT_DOUBLE_EQ(s.max, 6.0);
  EXPECT_EQ(s.n, 4U);
  EXPECT_DOUBLE_EQ(statistics({5, 1, 2}).median, 2.0);
  EXPECT_EQ(statistics({}).n, 0U);
}

TEST(Umeyama, RecoversAKnownTransformAndAllErrorsVanish) {
  const Trajectory reference = drive(300, 1.0, 0.02);
  Vector6d twist;
  twist << 10, -20, 3, 0.3, -1.2, 2.0;
  const Eigen::Matrix4d moved = matrix(se3_exp(twist));
  const Trajectory estimate = transformed(moved, reference);
  EXPECT_LT((alignment_transform(reference, estimate, Alignment::kSe3) * moved - Eigen::Matrix4d::Identity())
                .norm(),
            1e-10);
  EXPECT_LT(
      (alignment_transform(reference, estimate, Alignment::kOrigin) * moved - Eigen::Matrix4d::Identity())
          .norm(),
      1e-10);
  EXPECT_LT(evaluate(reference, estimate, Alignment::kSe3).ate.max, 1e-10);
  EXPECT_GT(evaluate(reference, estimate, Alignment::kNone).ate.rmse, 5.0);
}

TEST(Umeyama, NeverMirrors) {
  // The mirror image of a flat path with a little height would fit best as a reflection.
  std::vector<Eigen::Vector3d> a, b;
  std::mt19937 rng(3);
  std::normal_distribution<double> noise;
  for (int i = 0; i < 50; ++i) {
    a.emplace_back(10 * noise(rng), 8 * noise(rng), 5 * noise(rng));
    b.emplace_back(a.back().x(), a.back().y(), -a.back().z());
  }
  EXPECT_NEAR((umeyama_se3(a, b).topLeftCorner<3, 3>().determinant()), 1.0, 1e-12);
}

TEST(Umeyama, SaysThatALineDoesNotDetermineIt) {
  const Trajectory line =
      make_trajectory({Pose(), Pose({1, 0, 0, 0}, {1, 0, 0}), Pose({1, 0, 0, 0}, {2, 0, 0})});
  try {
    evaluate(line, line, Alignment::kSe3);
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("--align origin"), std::string::npos);
  }
  EXPECT_EQ(evaluate(line, line, Alignment::kOrigin).ate.max, 0.0);
}

TEST(Ate, OfAConstantOffsetIsThatOffset) {
  const Trajectory reference = drive(100, 1.0, 0.05);
  Trajectory estimate = reference;
  for (auto& pose : estimate.poses) pose.topRightCorner<3, 1>() += Eigen::Vector3d(3, 0, 4);
  const ErrorStatistics ate = evaluate(reference, estimate, Alignment::kNone).ate;
  EXPECT_NEAR(ate.rmse, 5.0, 1e-12);
  EXPECT_NEAR(ate.std, 0.0, 1e-10);
  EXPECT_NEAR(ate.sse, 2500.0, 1e-9);
  EXPECT_LT(evaluate(reference, estimate, Alignment::kOrigin).ate.max, 1e-10);
}

TEST(Rpe, OfAWrongStepAndAWrongYawRate) {
  const Trajectory reference = drive(101, 1.0, 0.0);
  const RelativeErrors step = relative_errors(reference, drive(101, 1.02, 0.0));
  ASSERT_EQ(step.translation_m.size(), 100U);
  for (const double e : step.translation_m) EXPECT_NEAR(e, 0.02 * std::sqrt(1.0001), 1e-9);
  const RelativeErrors turn = relative_errors(reference, drive(101, 1.0, M_PI / 180.0));
  for (const double e : turn.rotation_deg) EXPECT_NEAR(e, 1.0, 1e-9);
  EXPECT_EQ(relative_errors(reference, reference, 10).translation_m.size(), 10U);
  EXPECT_EQ(relative_errors(reference, reference, 10, true).translation_m.size(), 91U);
}

TEST(Kitti, OfAScaleErrorIsThatScale) {
  Trajectory reference = drive(1201, 1.0, 0.0);
  Trajectory estimate = reference;
  for (auto& pose : estimate.poses) pose.topRightCorner<3, 1>() *= 1.01;
  const KittiError error = kitti_error(reference, estimate);
  // A segment ends at the first pose beyond its length (here one pose, 1 m, farther than it).
  double expected = 0;
  std::size_t n = 0;
  const double pace = std::sqrt(1.0001);
  for (std::size_t first = 0; first <= 1200; first += 10) {
    for (int length = 100; length <= 800; length += 100) {
      const std::size_t steps = static_cast<std::size_t>(std::floor(length / pace)) + 1;
      if (first + steps > 1200) continue;
      expected += 0.01 * pace * static_cast<double>(steps) / length;
      ++n;
    }
  }
  EXPECT_EQ(error.segments, n);
  EXPECT_NEAR(error.t_percent, 100 * expected / static_cast<double>(n), 1e-9);
  EXPECT_NEAR(error.r_deg_per_100m, 0.0, 1e-5);
}

TEST(Kitti, OfADriveThatIsTooShortIsNull) {
  const Trajectory reference = drive(50, 1.0, 0.01);
  const auto json = to_json(evaluate(reference, reference, Alignment::kSe3));
  EXPECT_TRUE(json["kitti"]["t_percent"].is_null());
  EXPECT_EQ(json["kitti"]["segments"], 0);
  EXPECT_EQ(json["ate"]["n"], 50);
}

// What evo's own code says of the two trajectories that evo publishes; printed there with 9 decimals.
class Evo : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string folder = std::string(HP2_SHARED_DIR) + "/data/evo/";
    if (!std::filesystem::exists(folder + "expected.json")) {
      GTEST_SKIP() << folder
                   << "expected.json is not there: configure with -DHP2_SHARED_DIR=... to compare with evo";
    }
    std::ifstream(folder + "expected.json") >> expected_;
    reference_ = read_trajectory(folder + "KITTI_00_ORB.txt");
    estimate_ = read_trajectory(folder + "KITTI_00_SPTAM.txt");
  }
  void compare(const std::string& key, const nlohmann::ordered_json& ours) {
    ASSERT_TRUE(expected_.contains(key));
    for (const auto& [name, value] : expected_[key].items()) {
      const double theirs = value;
      EXPECT_NEAR(ours[name].get<double>(), theirs, 1e-6 * std::abs(theirs) + 0.6e-9) << key << " " << name;
    }
  }
  nlohmann::json expected_;
  Trajectory reference_, estimate_;
};

TEST_F(Evo, ApeAlignedByOriginAndNotAtAll) {
  compare("ape_translation_se3_aligned", to_json(evaluate(reference_, estimate_, Alignment::kSe3))["ate"]);
  compare("ape_translation_origin_aligned",
          to_json(evaluate(reference_, estimate_, Alignment::kOrigin))["ate"]);
  compare("ape_translation_unaligned", to_json(evaluate(reference_, estimate_, Alignment::kNone))["ate"]);
}

TEST_F(Evo, Rpe) {
  const auto json = to_json(evaluate(reference_, estimate_, Alignment::kSe3));
  compare("rpe_translation_delta_1_frame", json["rpe_translation"]);
  compare("rpe_rotation_deg_delta_1_frame", json["rpe_rotation_deg"]);
}

TEST_F(Evo, KittiMetric) {
  const KittiError error = kitti_error(reference_, estimate_);
  const auto& theirs = expected_["kitti_odometry_step_10_not_evo"];
  EXPECT_NEAR(error.t_percent, theirs["t_percent"], 1e-6 * 1.2);  // printed with 6 decimals
  EXPECT_NEAR(error.r_deg_per_100m, theirs["r_deg_per_100m"], 1e-6);
  EXPECT_EQ(error.segments, theirs["segments"].get<std::size_t>());
}

}  // namespace
}  // namespace hp2
