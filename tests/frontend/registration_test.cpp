// Registration recovers known transforms in all modes, and tells what it cannot observe.
#include "common/registration/registration.hpp"

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

#include "frontend/frontend_config.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

using test::Cloud;
using test::Dice;

RegistrationConfig in_mode(const std::string& mode) {
  FrontendConfig frontend;
  frontend.mode = mode;
  RegistrationConfig config;
  config.icp = icp_config(frontend);
  return config;
}

// Information of a pose: symmetric, no negative eigenvalue.
void expect_positive_semidefinite(const Matrix6d& m) {
  ASSERT_TRUE(m.allFinite());
  EXPECT_LE((m - m.transpose()).norm(), 1e-9 * m.norm());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(0.5 * (m + m.transpose()));
  EXPECT_GE(eigen.eigenvalues()[0], -1e-9 * eigen.eigenvalues()[5]);
  EXPECT_GT(eigen.eigenvalues()[5], 0.0);
}

class RegistrationModes : public ::testing::TestWithParam<std::string> {};

TEST_P(RegistrationModes, RecoverKnownTransforms) {
  const RegistrationConfig config = in_mode(GetParam());
  const Cloud target = test::room(1);
  const bool points_only = config.icp.mode == IcpMode::kPointToPoint;
  Dice dice(2);
  for (int trial = 0; trial < 6; ++trial) {
    // Where the sensor stands is known to 0.6 m an axis and 3 degrees.
    const Pose truth = dice.pose(2.0, 0.4);
    const Pose guess = truth * dice.pose(0.6, 0.05);
    const Cloud source = test::seen_from(test::room(100U + static_cast<unsigned>(trial), 1200), truth);
    const RegistrationResult r = register_clouds(target, source, guess, config, 1.0, 0.6);
    const Pose off = truth.inverse() * r.target_from_source;
    EXPECT_LT(off.translation.norm(), points_only ? 0.15 : 0.06) << "trial " << trial;
    EXPECT_LT(rotation_angle(off.rotation), points_only ? 0.02 : 0.01) << "trial " << trial;
    EXPECT_GT(r.inlier_ratio, 0.8);
    EXPECT_LE(r.inlier_ratio, 1.0);
    EXPECT_GE(r.rms_m, 0.0);
    EXPECT_LT(r.rms_m, 0.6);
    EXPECT_GT(r.iterations, 0);
    EXPECT_GT(r.n_planar + r.n_non_planar, 100);
    expect_positive_semidefinite(r.information);
  }
}

TEST_P(RegistrationModes, OneTargetForManySources) {
  const RegistrationConfig config = in_mode(GetParam());
  const Cloud target = test::room(3);
  LocalMap map = registration_target(target, config);
  for (unsigned k = 0; k < 3; ++k) {
    const Cloud source = test::seen_from(test::room(5 + k, 2000), Dice(4 + k).pose(1.0, 0.2));
    const auto own = register_clouds(target, source, Pose(), config, 1.5, 0.6);
    const auto shared = register_cloud(map, source, Pose(), config, 1.5, 0.6);
    EXPECT_TRUE(test::same_bits(own.target_from_source, shared.target_from_source));
    EXPECT_EQ(own.information, shared.information);
  }
}

TEST_P(RegistrationModes, DoNotDependOnThreads) {
  const RegistrationConfig config = in_mode(GetParam());
  const Cloud target = test::room(3);
  const Pose truth = Dice(4).pose(1.0, 0.2);
  const Cloud source = test::seen_from(test::room(5, 2000), truth);
  const auto one = register_clouds(target, source, Pose(), config, 1.5, 0.6, 1);
  const auto two = register_clouds(target, source, Pose(), config, 1.5, 0.6, 2);
  EXPECT_TRUE(test::same_bits(one.target_from_source, two.target_from_source));
  EXPECT_EQ(one.information, two.information);
  EXPECT_EQ(one.rms_m, two.rms_m);
}

INSTANTIATE_TEST_SUITE_P(All, RegistrationModes, ::testing::ValuesIn(frontend_modes()),
                         [](const auto& mode) { return mode.param; });

TEST(Registration, PlanarWallsGivePlanarCorrespondences) {
  const auto r = register_clouds(test::room(6), test::room(7, 1500), Pose(), in_mode("robust"), 1.0, 0.6);
  EXPECT_GT(r.n_planar, 2 * r.n_non_planar);
  const RegistrationConfig points = in_mode("point_to_point");
  EXPECT_EQ(register_clouds(test::room(6), test::room(7, 1500), Pose(), points, 1.0, 0.6).n_planar, 0);
}

TEST(Registration, CorridorIsWeakerObservedThanARoom) {
  for (const std::string mode : {"hybrid", "point_to_plane", "robust"}) {
    const RegistrationConfig config = in_mode(mode);
    const auto room = register_clouds(test::room(8), test::room(9, 1500), Pose(), config, 1.0, 0.6);
    const auto corridor =
        register_clouds(test::corridor(8), test::corridor(9, 1500), Pose(), config, 1.0, 0.6);
    EXPECT_GT(room.min_eigenvalue_ratio, 0.0);
    EXPECT_GE(corridor.min_eigenvalue_ratio, 0.0);
    EXPECT_LT(corridor.min_eigenvalue_ratio, room.min_eigenvalue_ratio) << mode;
    expect_positive_semidefinite(corridor.information);
    if (mode != "robust") {
      EXPECT_LT(corridor.min_eigenvalue_ratio, 0.1 * room.min_eigenvalue_ratio) << mode;
      // The direction that is not seen is the corridor's.
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(
          Eigen::Matrix3d(corridor.information.topLeftCorner<3, 3>()));
      EXPECT_GT(std::abs(eigen.eigenvectors()(0, 0)), 0.99) << mode;
    }
  }
}

TEST(Registration, NothingToRegisterGivesTheGuessBack) {
  const Pose guess = Dice(10).pose(1.0, 0.3);
  const RegistrationConfig config = in_mode("robust");
  for (const auto& [target, source] :
       {std::pair<Cloud, Cloud>{{}, test::room(1, 50)}, {test::room(1, 50), {}}, {{}, {}}}) {
    const auto r = register_clouds(target, source, guess, config, 1.0, 0.6);
    EXPECT_TRUE(test::same_bits(r.target_from_source, guess));
    EXPECT_FALSE(r.converged);
    EXPECT_EQ(r.inlier_ratio, 0.0);
  }
  // A cloud that lies elsewhere altogether finds no partner.
  Cloud elsewhere = test::room(1, 200);
  for (auto& p : elsewhere) p.x() += 500.0F;
  const auto r = register_clouds(test::room(2), elsewhere, Pose(), config, 1.0, 0.6);
  EXPECT_EQ(r.n_planar + r.n_non_planar, 0);
  EXPECT_TRUE(r.target_from_source.is_finite());
  EXPECT_TRUE(r.information.allFinite());
}

}  // namespace
}  // namespace hp2
