// Sums of the Gauss-Newton system, kept apart by kind of residual so that they can be balanced after they
// were taken.
#pragma once
#include <cmath>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// sum w n-residuals: J = [n^T, (p x n)^T], e = n^T (p - q); upper triangle of J^T J and J^T e.
struct PlaneSums {
  double h[21] = {};
  double g[6] = {};
  double squares = 0.0;  ///< sum w e^2
  int count = 0;

  void add(const PlaneSums& o) {
    for (int i = 0; i < 21; ++i) h[i] += o.h[i];
    for (int i = 0; i < 6; ++i) g[i] += o.g[i];
    squares += o.squares;
    count += o.count;
  }
  Matrix6d information() const {
    Matrix6d m;
    int k = 0;
    for (int a = 0; a < 6; ++a) {
      for (int b = a; b < 6; ++b) m(a, b) = m(b, a) = h[k++];
    }
    return m;
  }
  Vector6d gradient() const { return Vector6d(g); }
  /// RMS of the weighted residuals [m]; 0 if there are none.
  double rms_m() const {
    const double w = h[0] + h[6] + h[11];  // unit normals: the trace of J^T J's translations
    return w > 0.0 ? std::sqrt(squares / w) : 0.0;
  }
};

/// sum w r-residuals: J = [I, -[p]x], r = p - q; the moments that J^T J and J^T r are made of.
struct PointSums {
  double w = 0.0;
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 6, 1> pp = Eigen::Matrix<double, 6, 1>::Zero();  ///< xx xy xz yy yz zz
  Eigen::Vector3d r = Eigen::Vector3d::Zero(), pxr = Eigen::Vector3d::Zero();
  double squares = 0.0;
  int count = 0;

  void add(const PointSums& o) {
    w += o.w;
    p += o.p;
    pp += o.pp;
    r += o.r;
    pxr += o.pxr;
    squares += o.squares;
    count += o.count;
  }
  Matrix6d information() const {
    Matrix6d m = Matrix6d::Zero();
    m.topLeftCorner<3, 3>() = w * Eigen::Matrix3d::Identity();
    m.topRightCorner<3, 3>() = -skew(p);
    m.bottomLeftCorner<3, 3>() = skew(p);
    Eigen::Matrix3d second;
    second << pp[0], pp[1], pp[2], pp[1], pp[3], pp[4], pp[2], pp[4], pp[5];
    m.bottomRightCorner<3, 3>() = second.trace() * Eigen::Matrix3d::Identity() - second;
    return m;
  }
  Vector6d gradient() const {
    Vector6d v;
    v << r, pxr;
    return v;
  }
  /// RMS of the weighted residuals [m]; 0 if there are none.
  double rms_m() const { return w > 0.0 ? std::sqrt(squares / w) : 0.0; }
};

/// All sums of one iteration. Points are relative to the local origin.
struct NormalEquations {
  PlaneSums planar;         ///< P, along the normal.
  PointSums planar_points;  ///< P, the whole residual (for the in-plane part).
  PointSums non_planar;     ///< Q.
  double fit = 0.0;         ///< Soft count of correspondences that agree (IcpResult::fit).

  void add(const NormalEquations& o) {
    planar.add(o.planar);
    planar_points.add(o.planar_points);
    non_planar.add(o.non_planar);
    fit += o.fit;
  }
};

}  // namespace hp2
