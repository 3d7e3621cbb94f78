#include "frontend/odometry/adaptive_scale.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {

AdaptiveScale::AdaptiveScale(double initial_m, double minimum_m, int window)
    : initial_(initial_m), minimum_(minimum_m), window_(static_cast<std::size_t>(std::max(1, window))) {}

double AdaptiveScale::sigma_m(double stretch) const {
  if (errors_.empty()) return initial_;
  double sum = 0.0;
  for (const double e : errors_) sum += e * e;
  return std::max(minimum_, stretch * std::sqrt(sum / static_cast<double>(errors_.size())));
}

double AdaptiveScale::error_m(const Pose& predicted_from_registered, double max_range_m) {
  const double theta = rotation_angle(predicted_from_registered.rotation);
  return predicted_from_registered.translation.norm() + 2.0 * max_range_m * std::sin(0.5 * theta);
}

void AdaptiveScale::add(double error_m, double stretch) {
  errors_.push_back(error_m / stretch);
  if (errors_.size() > window_) errors_.pop_front();
}

void AdaptiveScale::save(ByteWriter& out) const {
  out.put(static_cast<std::uint32_t>(errors_.size()));
  for (const double e : errors_) out.put(e);
}

void AdaptiveScale::load(ByteReader& in) {
  errors_.clear();
  const auto n = in.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < n; ++i) {
    errors_.push_back(in.take<double>());
    if (!(errors_.back() >= 0.0 && errors_.back() < 1e8)) in.fail("motion errors");
  }
}

}  // namespace hp2
