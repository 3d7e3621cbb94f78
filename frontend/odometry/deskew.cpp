#include "frontend/odometry/deskew.hpp"

namespace hp2 {

Deskew::Deskew(const Vector6d& sweep_twist) {
  for (int i = 0; i <= kNodes; ++i) {
    const double s = static_cast<double>(i) / kNodes;
    nodes_[static_cast<std::size_t>(i)] = se3_exp((s - 1.0) * sweep_twist).matrix().cast<float>();
  }
}

}  // namespace hp2
