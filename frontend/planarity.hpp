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
  /// Adds `other`, whose reference lies at `shift` [m] along an axis (0, 1 or 2) from this one's.
  template <int axis>
  void add_shifted_along(const Moments& other, double shift) {
    // Places of the axis' own product and of its products with the next two axes.
    constexpr int kOwn[] = {0, 3, 5}, kFirst[] = {1, 1, 2}, kSecond[] = {2, 4, 4};
    constexpr int kFirstAxis[] = {1, 0, 0}, kSecondAxis[] = {2, 2, 1};
    const double moved = other.n * shift;
    products += other.products;
    products[kOwn[axis]] += shift * (2.0 * other.sum[axis] + moved);
    products[kFirst[axis]] += shift * other.sum[kFirstAxis[axis]];
    products[kSecond[axis]] += shift * other.sum[kSecondAxis[axis]];
    sum += other.sum;
    sum[axis] += moved;
    n += other.n;
  }
  /// Covariance (1/n) sum (p - mean)(p - mean)^T [m^2]; zero for n = 0.
  Eigen::Matrix3d covariance() const;
  Eigen::Vector3d mean() const { return n > 0.0 ? Eigen::Vector3d(sum / n) : Eigen::Vector3d::Zero(); }
};

/// Shape of a neighbourhood.
struct Planarity {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< Unit eigenvector of the smallest eigenvalue.
  Eigen::Vector3f mean = Eigen::Vector3f::Zero();    ///< Of the neighbourhood, from the voxel's corner [m].
  float score = 1.0F;                                ///< s = l3 / (l1 + l2 + l3), 0..1/3; 1: too few points.
  float n = 0.0F;                                    ///< Points in the neighbourhood.
  float linearity = 0.0F;  ///< (l1 - l2) / l1, 0..1; near 1 the points lie on a line.
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
