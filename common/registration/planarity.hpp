// Is the map planar here? Moment sums of a neighbourhood, their covariance and eigenvalues, the planarity
// score s (paper, eq. 4) and the neighbourhood-size adaptive threshold tau(n) (paper, eq. 5).
#pragma once
#include <Eigen/Core>

namespace hp2 {

/// Sums over points about a reference point: n, sum p, sum p p^T. Sums about different references can be
/// added after moving one of them, so a neighbourhood's covariance comes from its voxels' sums without
/// visiting the points.
struct Moments {
  double n = 0.0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();  ///< [m]
  /// xx, xy, xz, yy, yz, zz [m^2]
  Eigen::Matrix<double, 6, 1> products = Eigen::Matrix<double, 6, 1>::Zero();

  void add(const Eigen::Vector3d& p);
  /// Adds `other`, whose reference lies at `shift` [m] from this one's.
  void add_shifted(const Moments& other, const Eigen::Vector3d& shift);
  /// Covariance (1/n) sum (p - mean)(p - mean)^T [m^2]; zero for n = 0.
  Eigen::Matrix3d covariance() const;
  Eigen::Vector3d mean() const { return n > 0.0 ? Eigen::Vector3d(sum / n) : Eigen::Vector3d::Zero(); }
};

/// Shape of a neighbourhood.
struct Planarity {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< Unit eigenvector of the smallest eigenvalue.
  float score = 1.0F;                                ///< s = l3 / (l1 + l2 + l3), 0..1/3; 1: too few points.
  float n = 0.0F;                                    ///< Points in the neighbourhood.
  /// Unit eigenvector of the largest eigenvalue where the points lie along a line (l2 < 0.1 l1), whose normal
  /// is one of many; zero: they do not.
  Eigen::Vector3f line = Eigen::Vector3f::Zero();
};

/// Eigenvalue analysis of a neighbourhood's moments.
Planarity analyse(const Moments& moments);

/// Eigenvalues in falling order and the unit eigenvector of the smallest one, of a symmetric positive matrix.
struct SmallestEigen {
  Eigen::Vector3d values;  ///< l1 >= l2 >= l3 >= 0
  Eigen::Vector3d normal;  ///< Belongs to l3.
};
SmallestEigen smallest_eigenvector(const Eigen::Matrix3d& m);

/// tau(n) = clamp(tau_ref * n_ref / n, tau_min, tau_max), for n > 0.
double adaptive_threshold(double n, double tau_ref, double n_ref, double tau_min, double tau_max);

}  // namespace hp2
