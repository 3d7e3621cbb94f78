#include "common/registration/planarity.hpp"

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

void Moments::add_shifted(const Moments& other, const Eigen::Vector3d& shift) {
  const Eigen::Vector3d moved = other.n * shift;
  int k = 0;
  for (int a = 0; a < 3; ++a) {
    for (int b = a; b < 3; ++b, ++k)
      products[k] += other.products[k] + shift[a] * other.sum[b] + shift[b] * (other.sum[a] + moved[a]);
  }
  sum += other.sum + moved;
  n += other.n;
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
  const double trace = m.trace();
  if (!(trace > 0.0)) {
    out.values.setZero();
    out.normal = Eigen::Vector3d::UnitZ();
    return out;
  }
  // Newton's method on the characteristic polynomial x^3 - x^2 + c1 x - c0 of m / trace, from 0. It converges
  // to the smallest root from below, faster where the next root is far away.
  const Eigen::Matrix3d a = m / trace;
  const double c1 = a(0, 0) * a(1, 1) - a(1, 0) * a(1, 0) + a(0, 0) * a(2, 2) - a(2, 0) * a(2, 0) +
                    a(1, 1) * a(2, 2) - a(2, 1) * a(2, 1);
  const double c0 = a.determinant();
  constexpr int kMostSteps = 8;
  constexpr double kStill = 1e-11, kLeastCross2 = 1e-14;
  double x = 0.0;
  for (int i = 0; i < kMostSteps; ++i) {
    const double slope = (3.0 * x - 2.0) * x + c1;
    if (!(slope > 0.0)) break;
    const double step = (((x - 1.0) * x + c1) * x - c0) / slope;
    x -= step;
    if (std::abs(step) > kStill) continue;
    // The rows of a - x I span the plane across the eigenvector.
    const Eigen::Matrix3d rows = a - x * Eigen::Matrix3d::Identity();
    const Eigen::Vector3d crosses[3] = {rows.col(0).cross(rows.col(1)), rows.col(0).cross(rows.col(2)),
                                        rows.col(1).cross(rows.col(2))};
    const double norms[3] = {crosses[0].squaredNorm(), crosses[1].squaredNorm(), crosses[2].squaredNorm()};
    const auto k = std::max_element(norms, norms + 3) - norms;
    if (norms[k] < kLeastCross2) break;
    const double half = 0.5 * (1.0 - x);
    const double spread = std::sqrt(std::max(0.0, half * half - (c1 - x * (1.0 - x))));
    out.values = trace * Eigen::Vector3d(half + spread, half - spread, std::max(0.0, x));
    out.normal = crosses[k] / std::sqrt(norms[k]);
    return out;
  }
  // Two nearly equal smallest eigenvalues.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
  out.values = solver.eigenvalues().reverse().cwiseMax(0.0);
  out.normal = solver.eigenvectors().col(0);
  return out;
}

Planarity analyse(const Moments& moments) {
  constexpr double kLine = 0.1;
  Planarity out;
  out.n = static_cast<float>(moments.n);
  if (moments.n < 3.0) return out;
  const Eigen::Matrix3d covariance = moments.covariance();
  const SmallestEigen e = smallest_eigenvector(covariance);
  const double total = e.values.sum();
  if (!(total > 0.0)) return out;
  out.normal = e.normal.cast<float>();
  out.score = static_cast<float>(e.values[2] / total);
  if (e.values[1] < kLine * e.values[0]) {
    // (m - l2 I) (m - l3 I) maps everything onto the eigenvector of l1.
    const Eigen::Matrix3d onto = (covariance - e.values[1] * Eigen::Matrix3d::Identity()) *
                                 (covariance - e.values[2] * Eigen::Matrix3d::Identity());
    Eigen::Index widest = 0;
    onto.colwise().squaredNorm().maxCoeff(&widest);
    out.line = onto.col(widest).normalized().cast<float>();
  }
  return out;
}

double adaptive_threshold(double n, double tau_ref, double n_ref, double tau_min, double tau_max) {
  return std::clamp(tau_ref * n_ref / n, tau_min, tau_max);
}

}  // namespace hp2
