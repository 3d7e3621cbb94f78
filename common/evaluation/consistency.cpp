#include "common/evaluation/consistency.hpp"

#include <limits>

#include <Eigen/Cholesky>

#include "common/error.hpp"

namespace hp2 {

std::vector<double> normalised_errors_squared(const std::vector<Pose>& reference,
                                              const std::vector<Pose>& estimate,
                                              const std::vector<Matrix6d>& covariances) {
  if (reference.size() != estimate.size() || reference.size() != covariances.size()) {
    throw Error("poses and covariances are not paired", "normalised errors", "Give one of each a pose.");
  }
  std::vector<double> errors;
  for (std::size_t i = 1; i < reference.size(); ++i) {
    const Pose truth = reference[i - 1].inverse() * reference[i];
    const Vector6d e = se3_log(truth.inverse() * (estimate[i - 1].inverse() * estimate[i]));
    const Eigen::LLT<Matrix6d> factor(covariances[i]);
    errors.push_back(factor.info() == Eigen::Success ? e.dot(factor.solve(e))
                                                     : std::numeric_limits<double>::quiet_NaN());
  }
  return errors;
}

}  // namespace hp2
