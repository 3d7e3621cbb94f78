#include "backend/odometry_noise.hpp"

#include <algorithm>

namespace hp2 {
namespace {

// Floors of a scan's motion error, found on simulated drives: a good odometry wanders by about 2 mm and 0.01
// degrees a square root of a metre, whatever its registrations say of themselves (their errors are not
// independent).
constexpr double kTranslationNoise = 2e-3;     // [m / sqrt(m)]
constexpr double kRotationNoise = 2e-4;        // [rad / sqrt(m)]
constexpr double kStandingStillLength = 0.01;  // [m]: a floor for the floors
// Where the registration was degenerate or lost, the pose is a prediction: its error is a share of the
// motion.
constexpr double kDegenerateShare = 0.05;
constexpr double kLostShare = 0.5;

}  // namespace

std::vector<OdometryStep> odometry_steps(const std::vector<ScanPose>& scans) {
  std::vector<OdometryStep> steps;
  steps.reserve(scans.size());
  Pose previous;
  for (const ScanPose& scan : scans) {
    OdometryStep step;
    step.previous_from_current = previous.inverse() * scan.submap_from_sensor;
    step.length_m = step.previous_from_current.translation.norm();
    const double length = std::max(step.length_m, kStandingStillLength);
    const double share = scan.state == TrackingState::kLost         ? kLostShare
                         : scan.state == TrackingState::kDegenerate ? kDegenerateShare
                                                                    : 0.0;
    const double translation =
        kTranslationNoise * kTranslationNoise * length + share * share * length * length;
    const double rotation =
        kRotationNoise * kRotationNoise * length + (scan.state == TrackingState::kLost ? 1e-4 : 0.0);
    const bool known = scan.covariance.allFinite() && scan.covariance.diagonal().minCoeff() >= 0.0;
    step.covariance =
        known ? Matrix6d(0.5 * (scan.covariance + scan.covariance.transpose())) : Matrix6d::Zero();
    step.covariance.diagonal().head<3>().array() += translation;
    step.covariance.diagonal().tail<3>().array() += rotation;
    steps.push_back(step);
    previous = scan.submap_from_sensor;
  }
  return steps;
}

Matrix6d accumulated_covariance(const std::vector<OdometryStep>& steps) {
  Matrix6d sum = Matrix6d::Zero();
  for (const OdometryStep& step : steps) {
    const Matrix6d a = adjoint(step.previous_from_current.inverse());
    sum = a * sum * a.transpose() + step.covariance;
  }
  return sum;
}

}  // namespace hp2
