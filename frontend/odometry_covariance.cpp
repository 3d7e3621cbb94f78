#include "frontend/odometry_covariance.hpp"

#include <algorithm>

#include <Eigen/LU>

namespace hp2 {

Matrix6d motion_covariance(const IcpResult& icp, double sigma_m) {
  constexpr double kNoise = 0.25;                            // [m]
  constexpr double kFloor = 0.003, kFloorRotation = 0.0003;  // [m], [rad]: of a map that is itself not exact
  const Matrix6d about_source =
      (icp.information + 1e-9 * Matrix6d::Identity()).inverse() * (kNoise * kNoise / (sigma_m * sigma_m));
  // Map axes to sensor axes; the last pose's own rotation changes nothing in what the increment is.
  const Eigen::Matrix3d r = icp.map_from_source.rotation.toRotationMatrix().transpose();
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = r;
  Matrix6d covariance = turn * about_source * turn.transpose();
  covariance.diagonal().head<3>().array() += kFloor * kFloor;
  covariance.diagonal().tail<3>().array() += kFloorRotation * kFloorRotation;
  return 0.5 * (covariance + covariance.transpose());
}

Matrix6d guess_covariance(const Pose& motion) {
  constexpr double kShare = 0.5, kLeast = 1.0, kRotation = 0.5;  // of the way; [m], [rad]
  const double deviation = std::max(kLeast, kShare * motion.translation.norm());
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(deviation * deviation);
  covariance.diagonal().tail<3>().setConstant(kRotation * kRotation);
  return covariance;
}

}  // namespace hp2
