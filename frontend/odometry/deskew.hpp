// Undoing the motion of the sensor within a sweep (paper, sec. "Implementation details"): p' = Exp((s - 1) w)
// p.
#pragma once
#include <array>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// Moves points of a sweep into the sensor's frame at the sweep's end, for a constant twist over the sweep.
class Deskew {
 public:
  /// @param sweep_twist w = Log(motion of the sensor from start to end of the sweep), (rho [m], phi [rad])
  explicit Deskew(const Vector6d& sweep_twist);

  /// @param p point [m] in the sensor's frame at its firing instant
  /// @param s that instant in the sweep, 0 = start, 1 = end; clamped to [0, 1]
  Eigen::Vector3f operator()(const Eigen::Vector3f& p, float s) const {
    // Between the nodes the matrix is interpolated: off by 1/8 (angle / kNodes)^2, under 1e-6 for a quarter
    // turn a sweep.
    const float scaled = s > 0.0F ? (s < 1.0F ? s * kNodes : kNodes) : 0.0F;
    const int node = scaled < kNodes ? static_cast<int>(scaled) : kNodes - 1;
    const float f = scaled - static_cast<float>(node);
    const auto& a = nodes_[static_cast<std::size_t>(node)];
    const auto& b = nodes_[static_cast<std::size_t>(node) + 1];
    const Eigen::Vector3f pa = a.leftCols<3>() * p + a.col(3);
    const Eigen::Vector3f pb = b.leftCols<3>() * p + b.col(3);
    return pa + f * (pb - pa);
  }

 private:
  static constexpr int kNodes = 256;
  std::array<Eigen::Matrix<float, 3, 4>, kNodes + 1> nodes_;
};

}  // namespace hp2
