#include "common/geometry/pose.hpp"

#include <cmath>

#include <Eigen/SVD>

namespace hp2 {
namespace {

// Below this angle the closed forms lose digits; the series is exact to double precision there.
constexpr double kSmallAngle = 1e-3;

// Coefficients of V = I + b [phi]x + c [phi]x^2, the left Jacobian of SO(3).
struct LeftJacobian {
  double b, c;
};

LeftJacobian left_jacobian(double angle) {
  const double a2 = angle * angle;
  if (angle < kSmallAngle) {
    return {0.5 - a2 / 24.0 + a2 * a2 / 720.0, 1.0 / 6.0 - a2 / 120.0 + a2 * a2 / 5040.0};
  }
  const double half = std::sin(0.5 * angle);
  return {2.0 * half * half / a2, (angle - std::sin(angle)) / (a2 * angle)};
}

}  // namespace

Pose Pose::from_matrix(const Eigen::Matrix<double, 3, 4>& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m.leftCols<3>(), Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d r = svd.matrixU() * svd.matrixV().transpose();
  if (r.determinant() < 0.0) {
    Eigen::Matrix3d u = svd.matrixU();
    u.col(2) = -u.col(2);
    r = u * svd.matrixV().transpose();
  }
  return {Eigen::Quaterniond(r), m.col(3)};
}

Eigen::Matrix<double, 3, 4> Pose::matrix() const {
  Eigen::Matrix<double, 3, 4> m;
  m << rotation.toRotationMatrix(), translation;
  return m;
}

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d s;
  s << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return s;
}

Eigen::Quaterniond so3_exp(const Eigen::Vector3d& phi) {
  const double angle = phi.norm();
  const double half = 0.5 * angle;
  const double k = angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  return Eigen::Quaterniond(std::cos(half), k * phi.x(), k * phi.y(), k * phi.z()).normalized();
}

Eigen::Vector3d so3_log(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  const double w = sign * q.w();
  const Eigen::Vector3d v = sign * q.vec();
  const double n = v.norm();
  if (n < 1e-9) return (2.0 / w) * v;
  return (2.0 * std::atan2(n, w) / n) * v;
}

Pose se3_exp(const Vector6d& twist) {
  const Eigen::Vector3d rho = twist.head<3>();
  const Eigen::Vector3d phi = twist.tail<3>();
  const LeftJacobian j = left_jacobian(phi.norm());
  const Eigen::Vector3d cross = phi.cross(rho);
  return {so3_exp(phi), rho + j.b * cross + j.c * phi.cross(cross)};
}

Vector6d se3_log(const Pose& pose) {
  const Eigen::Vector3d phi = so3_log(pose.rotation);
  const double angle = phi.norm();
  // V^-1 = I - [phi]x / 2 + k [phi]x^2; k = (1 - (angle/2) cot(angle/2)) / angle^2, finite at pi.
  double k = 1.0 / 12.0 + angle * angle / 720.0;
  if (angle >= kSmallAngle) {
    const double half = 0.5 * angle;
    k = (1.0 - half * std::cos(half) / std::sin(half)) / (angle * angle);
  }
  const Eigen::Vector3d cross = phi.cross(pose.translation);
  Vector6d twist;
  twist << pose.translation - 0.5 * cross + k * phi.cross(cross), phi;
  return twist;
}

Matrix6d adjoint(const Pose& pose) {
  const Eigen::Matrix3d r = pose.rotation.toRotationMatrix();
  Matrix6d ad = Matrix6d::Zero();
  ad.topLeftCorner<3, 3>() = r;
  ad.topRightCorner<3, 3>() = skew(pose.translation) * r;
  ad.bottomRightCorner<3, 3>() = r;
  return ad;
}

double rotation_angle(const Eigen::Quaterniond& q) {
  return 2.0 * std::atan2(q.vec().norm(), std::abs(q.w()));
}

Pose interpolate(const Pose& a, const Pose& b, double s) { return a * se3_exp(s * se3_log(a.inverse() * b)); }

}  // namespace hp2
