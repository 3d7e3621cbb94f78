#include "frontend/planarity.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace hp2 {

void Moments::add(const Eigen::Vector3d& p) {
  n += 1.0;
  sum += p;
  products[0] += p.x() * p.x();
  products[1] += p.x() * p.y();
  products[2] += p.x() * p.z();
  products[3] += p.y() * p.y();
  products[4] += p.y() * p.z();
  products[5] += p.z() * p.z();
}

Eigen::Matrix3d Moments::covariance() const {
  Eigen::Matrix3d c = Eigen::Matrix3d::Zero();
  if (n <= 0.0) return c;
  const Eigen::Vector3d m = sum / n;
  c(0, 0) = products[0] / n - m.x() * m.x();
  c(1, 0) = c(0, 1) = products[1] / n - m.x() * m.y();
  c(2, 0) = c(0, 2) = products[2] / n - m.x() * m.z();
  c(1, 1) = products[3] / n - m.y() * m.y();
  c(2, 1) = c(1, 2) = products[4] / n - m.y() * m.z();
  c(2, 2) = products[5] / n - m.z() * m.z();
  return c;
}

SmallestEigen smallest_eigenvector(const Eigen::Matrix3d& m) {
  SmallestEigen out;
  // Closed form for the values (trigonometric solution of the characteristic cubic), scaled to keep its
  // digits.
  const double scale = m.cwiseAbs().maxCoeff();
  if (!(scale > 0.0)) {
    out.values.setZero();
    out.normal = Eigen::Vector3d::UnitZ();
    return out;
  }
  const Eigen::Matrix3d a = m / scale;
  const double q = a.trace() / 3.0;
  const double p2 = (a(0, 0) - q) * (a(0, 0) - q) + (a(1, 1) - q) * (a(1, 1) - q) +
                    (a(2, 2) - q) * (a(2, 2) - q) +
                    2.0 * (a(1, 0) * a(1, 0) + a(2, 0) * a(2, 0) + a(2, 1) * a(2, 1));
  const double p = std::sqrt(p2 / 6.0);
  if (p > 1e-9) {
    const Eigen::Matrix3d b = (a - q * Eigen::Matrix3d::Identity()) / p;
    const double half_det = std::clamp(0.5 * b.determinant(), -1.0, 1.0);
    const double angle = std::acos(half_det) / 3.0;
    const double l1 = q + 2.0 * p * std::cos(angle);
    const double l3 = q + 2.0 * p * std::cos(angle + 2.0 * M_PI / 3.0);
    const double l2 = 3.0 * q - l1 - l3;
    // (A - l1 I)(A - l2 I) has columns along l3's eigenvector; take the longest.
    const Eigen::Matrix3d c = (a - l1 * Eigen::Matrix3d::Identity()) * (a - l2 * Eigen::Matrix3d::Identity());
    const Eigen::Vector3d norms = c.colwise().squaredNorm();
    Eigen::Index k = 0;
    const double best = norms.maxCoeff(&k);
    if (best > 1e-14) {
      out.values = scale * Eigen::Vector3d(l1, l2, std::max(0.0, l3));
      out.normal = c.col(k) / std::sqrt(best);
      return out;
    }
  }
  // Repeated eigenvalues: the closed form has no direction to give.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
  out.values = solver.eigenvalues().reverse().cwiseMax(0.0);
  out.normal = solver.eigenvectors().col(0);
  return out;
}

Planarity analyse(const Moments& moments) {
  Planarity out;
  out.n = static_cast<float>(moments.n);
  out.mean = moments.mean().cast<float>();
  if (moments.n < 3.0) return out;
  const SmallestEigen e = smallest_eigenvector(moments.covariance());
  const double total = e.values.sum();
  if (!(total > 0.0)) return out;
  out.normal = e.normal.cast<float>();
  out.score = static_cast<float>(e.values[2] / total);
  out.linearity = static_cast<float>((e.values[0] - e.values[1]) / e.values[0]);
  return out;
}

double adaptive_threshold(double n, double tau_ref, double n_ref, double tau_min, double tau_max) {
  return std::clamp(tau_ref * n_ref / n, tau_min, tau_max);
}

}  // namespace hp2
