#include "backend/graph/odometry_noise.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {
namespace {

// Floors of a scan's motion error, found on simulated drives. A good odometry drifts by about 2 mm and 0.01
// degrees per square root of a metre, even where its covariances are smaller: registration errors are not
// independent.
constexpr double kTranslationNoise = 2e-3;     // [m / sqrt(m)]
constexpr double kRotationNoise = 2e-4;        // [rad / sqrt(m)]
constexpr double kStandingStillLength = 0.01;  // [m]: a floor for the floors
// Where the registration was degenerate, the pose is a prediction in some direction: its error is a share of
// the motion.
constexpr double kDegenerateShare = 0.05;
// Deskewing assumes constant velocity within a sweep, so part of the change of motion from scan to scan is
// missing in it. That is little on a vehicle, and a lot in a hand that turns quickly.
constexpr double kUnevenShare = 0.2, kMostUneven = 10.0;
// Where tracking was lost, the pose is a prediction at constant velocity since the last registered scan. The
// deviations are those of a vehicle or a person.
constexpr double kLostShare = 0.5;         // of the predicted motion
constexpr double kLostAcceleration = 2.0;  // [m/s^2]
constexpr double kLostTurnRate = 0.5;      // [rad/s]
constexpr double kMostLost_rad = 2.0;      // any heading
constexpr double kMinLost_m = 0.3, kMinLost_rad = 0.05;
constexpr double kDefaultPeriod_s = 0.1;

// Median time between scans [s].
double period_s(const std::vector<ScanPose>& scans) {
  std::vector<std::int64_t> steps;
  for (std::size_t i = 1; i < scans.size(); ++i) {
    if (scans[i].utime > scans[i - 1].utime) steps.push_back(scans[i].utime - scans[i - 1].utime);
  }
  if (steps.empty()) return kDefaultPeriod_s;
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  return 1e-6 * static_cast<double>(steps[steps.size() / 2]);
}

Matrix6d isotropic(double translation_m, double rotation_rad) {
  Vector6d squares;
  squares << Eigen::Vector3d::Constant(translation_m * translation_m),
      Eigen::Vector3d::Constant(rotation_rad * rotation_rad);
  return squares.asDiagonal();
}

}  // namespace

std::vector<OdometryStep> odometry_steps(const std::vector<ScanPose>& scans, std::int64_t utime_before) {
  std::vector<OdometryStep> steps;
  steps.reserve(scans.size());
  const double period = period_s(scans);
  Pose previous;
  std::int64_t before = utime_before;
  for (const ScanPose& scan : scans) {
    OdometryStep step;
    step.previous_from_current = previous.inverse() * scan.submap_from_sensor;
    step.length_m = step.previous_from_current.translation.norm();
    step.duration_s =
        before > 0 && scan.utime > before ? 1e-6 * static_cast<double>(scan.utime - before) : period;
    const double length = std::max(step.length_m, kStandingStillLength);
    const double share = scan.state == TrackingState::kDegenerate ? kDegenerateShare : 0.0;
    const bool known = scan.covariance.allFinite() && scan.covariance.diagonal().minCoeff() >= 0.0;
    step.covariance =
        known ? Matrix6d(0.5 * (scan.covariance + scan.covariance.transpose())) : Matrix6d::Zero();
    step.covariance += isotropic(std::hypot(kTranslationNoise * std::sqrt(length), share * length),
                                 kRotationNoise * std::sqrt(length));
    if (scan.state == TrackingState::kLost) {
      const double dt = step.duration_s;
      step.loss = true;
      step.loss_m = kMinLost_m + kLostShare * step.length_m + 0.5 * kLostAcceleration * dt * dt;
      step.loss_rad = std::min(kMostLost_rad, kMinLost_rad + kLostTurnRate * dt);
      step.covariance += isotropic(step.loss_m, step.loss_rad);
    } else if (!steps.empty() && !steps.back().loss) {
      const double rate = std::min(step.duration_s / steps.back().duration_s, kMostUneven);
      const Vector6d change =
          se3_log(step.previous_from_current) - rate * se3_log(steps.back().previous_from_current);
      step.covariance +=
          isotropic(kUnevenShare * change.head<3>().norm(), kUnevenShare * change.tail<3>().norm());
    }
    steps.push_back(step);
    previous = scan.submap_from_sensor;
    before = scan.utime;
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
