// Rigid transforms: the SE(3) type that every stage uses, its exponential and its logarithm.
#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

namespace hp2 {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A rigid transform `a_from_b`: maps coordinates of frame b into frame a. Translation in metres.
/// The rotation is kept a unit quaternion by every operation here, so that chains of products (the
/// constant-velocity prediction above all) stay in SO(3).
struct Pose {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Pose() = default;
  /// Normalises `q`. `q` must not be zero.
  Pose(const Eigen::Quaterniond& q, const Eigen::Vector3d& t) : rotation(q.normalized()), translation(t) {}

  /// From a 3x4 or 4x4 matrix whose left 3x3 block is a rotation up to rounding; the nearest rotation is
  /// taken.
  static Pose from_matrix(const Eigen::Matrix<double, 3, 4>& m);

  Pose operator*(const Pose& o) const {
    return {rotation * o.rotation, rotation * o.translation + translation};
  }
  Eigen::Vector3d operator*(const Eigen::Vector3d& p) const { return rotation * p + translation; }
  Pose inverse() const {
    const Eigen::Quaterniond q = rotation.conjugate();
    return {q, -(q * translation)};
  }
  /// 3x4 matrix [R | t].
  Eigen::Matrix<double, 3, 4> matrix() const;
  bool is_finite() const { return rotation.coeffs().allFinite() && translation.allFinite(); }
};

/// 3x3 matrix S with S x = v cross x.
Eigen::Matrix3d skew(const Eigen::Vector3d& v);

/// Rotation of the rotation vector `phi` [rad].
Eigen::Quaterniond so3_exp(const Eigen::Vector3d& phi);
/// Rotation vector [rad] of `q`, its angle in [0, pi]. Exact to rounding over the whole range.
Eigen::Vector3d so3_log(const Eigen::Quaterniond& q);

/// Exponential of the twist (rho, phi): translation part [m] first, rotation vector [rad] second.
Pose se3_exp(const Vector6d& twist);
/// Logarithm, the inverse of se3_exp for rotation angles up to pi.
Vector6d se3_log(const Pose& pose);
/// Adjoint: se3_exp(Ad(T) x) = T se3_exp(x) T^-1, twists ordered (rho, phi).
Matrix6d adjoint(const Pose& pose);

/// Angle [rad] of the rotation between identity and `q`, in [0, pi].
double rotation_angle(const Eigen::Quaterniond& q);

/// Geodesic interpolation from `a` (s = 0) to `b` (s = 1), extrapolating outside [0, 1].
Pose interpolate(const Pose& a, const Pose& b, double s);

}  // namespace hp2
