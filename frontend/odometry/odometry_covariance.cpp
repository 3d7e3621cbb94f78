#include "frontend/odometry/odometry_covariance.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace hp2 {

namespace {

// Found on simulated drives by maximum likelihood, one rule for all sensors and scenes.
constexpr double kCorrelated = 2.0;  // errors of neighbouring points are correlated: factor on the residuals
constexpr double kLeastResidual = 0.01;                      // [m]: no sensor measures better
constexpr double kFloor = 0.0013, kFloorRotation = 0.00018;  // [m], [rad]: of a map that is itself not exact
// Shares of the change of motion, and of that change's own change, that deskewing at constant velocity leaves
// in the pose: in the direction of the change, and in any other.
constexpr double kChange = 0.36, kChangeAcross = 0.07;
constexpr double kJerk = 0.31, kJerkAcross = 0.055;

Matrix6d share_of(const Vector6d& motion, double along, double across) {
  Matrix6d covariance = along * along * motion * motion.transpose();
  covariance.diagonal().head<3>().array() += across * across * motion.head<3>().squaredNorm();
  covariance.diagonal().tail<3>().array() += across * across * motion.tail<3>().squaredNorm();
  return covariance;
}

}  // namespace

Matrix6d registration_covariance(const IcpResult& icp, double sigma_m) {
  // With the robust weights the information is that of residuals with deviation sigma.
  const double residual = kCorrelated * std::max(kLeastResidual, icp.rms_m) / sigma_m;
  const Matrix6d about_source =
      (icp.information + 1e-9 * Matrix6d::Identity()).inverse() * (residual * residual);
  // Map axes to sensor axes; the last pose's own rotation does not change the increment.
  const Eigen::Matrix3d r = icp.map_from_source.rotation.toRotationMatrix().transpose();
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = r;
  Matrix6d covariance = turn * about_source * turn.transpose();
  covariance.diagonal().head<3>().array() += kFloor * kFloor;
  covariance.diagonal().tail<3>().array() += kFloorRotation * kFloorRotation;
  return 0.5 * (covariance + covariance.transpose());
}

double weakest_deviation_m(const Matrix6d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance.topLeftCorner<3, 3>(),
                                                             Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, eigen.eigenvalues()[2]));
}

Matrix6d deskew_covariance(const Unevenness& uneven) {
  return share_of(uneven.change, kChange, kChangeAcross) + share_of(uneven.jerk, kJerk, kJerkAcross);
}

Matrix6d guess_covariance(const Pose& motion) {
  constexpr double kShare = 0.5, kLeast = 1.0, kRotation = 0.5;  // of the motion; [m], [rad]
  const double deviation = std::max(kLeast, kShare * motion.translation.norm());
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(deviation * deviation);
  covariance.diagonal().tail<3>().setConstant(kRotation * kRotation);
  return covariance;
}

}  // namespace hp2
