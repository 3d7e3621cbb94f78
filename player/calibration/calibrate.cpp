#include "player/calibration/calibrate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Cholesky>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include "player/calibration/plane_system.hpp"

namespace hp2 {
namespace {

constexpr double kDegree = M_PI / 180.0;
// Patches are found with this largest l3 / l2: planes are thick before the errors are known.
constexpr double kFirstThickness = 0.1, kLastThickness = 0.005;
// Nor may they be thicker than this many times the deviation of points from their planes, or than this.
constexpr double kThickest = 3.7, kThickest_m = 0.015;
constexpr double kBiasPrior_deg = 3.0;
constexpr std::size_t kFewestWindows = 3;
constexpr std::size_t kFewestPoints = 200;  // of a ring that counts for the bias

/// Information of what is known before: rings differ little, their common angle may be anything.
Eigen::MatrixXd prior_information(const SensorErrors& errors, const CalibrationConfig& config) {
  const auto inverse_square = [](double deviation) { return 1.0 / (deviation * deviation); };
  const auto rings = static_cast<double>(errors.rings());
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(errors.values.size(), errors.values.size());
  const double angle = inverse_square(config.ring_angle_prior_deg * kDegree);
  const double bias = inverse_square(kBiasPrior_deg * kDegree);
  for (std::size_t a = 0; a < errors.rings(); ++a) {
    for (std::size_t b = 0; b < errors.rings(); ++b)
      prior(errors.angle(a), errors.angle(b)) = (bias / rings - angle) / rings;
    prior(errors.angle(a), errors.angle(a)) += angle;
    prior(errors.range(a), errors.range(a)) = inverse_square(config.ring_range_prior_m);
    prior(errors.azimuth(a), errors.azimuth(a)) = inverse_square(config.azimuth_prior_deg * kDegree);
  }
  prior(errors.grazing(), errors.grazing()) = inverse_square(config.grazing_prior);
  return prior;
}

class Calibration {
 public:
  Calibration(std::vector<CalibrationWindow>& windows, std::size_t rings, const CalibrationConfig& config,
              const Parallel& parallel)
      : windows_(windows), config_(config), parallel_(parallel), errors_(rings) {}

  CalibrationEstimate run() {
    CalibrationEstimate out;
    const Eigen::MatrixXd prior = prior_information(errors_, config_);
    for (int i = 0; i < config_.most_iterations && !out.settled; ++i) {
      build(shape(i));
      if (i == 0) out.thickness_before_m = thickness();
      Eigen::MatrixXd information = prior;
      Eigen::VectorXd gradient = -prior * errors_.values;
      for (const PlaneSystem& s : systems_) {
        information += s.errors;
        gradient += s.error_gradient;
      }
      const Eigen::VectorXd step = information.ldlt().solve(gradient);
      move(step);
      const double change = mean_angle(step) / kDegree;
      spdlog::debug("iteration {}: bias {:.4f} deg (step {:.4f}), grazing {:.2e}, planes {:.4f} m thick", i,
                    mean_angle(errors_.values) / kDegree, change, errors_.values[errors_.grazing()],
                    thickness());
      out.settled = i > 4 && std::abs(change) < config_.settled_deg;
    }
    build(shape(config_.most_iterations));
    report(prior, out);
    return out;
  }

 private:
  double mean_angle(const Eigen::VectorXd& values) const {
    return values.head(static_cast<Eigen::Index>(errors_.rings())).mean();
  }

  double thickness() const {
    double sum = 0.0;
    for (const PlaneSystem& s : systems_) sum += s.thickness_m;
    return systems_.empty() ? 0.0 : sum / static_cast<double>(systems_.size());
  }

  PlaneShape shape(int iteration) const {
    PlaneShape s;
    s.thickness = std::max(kFirstThickness * std::pow(0.5, iteration), kLastThickness);
    if (iteration > 0) s.thickest_m = std::max(kThickest * thickness(), kThickest_m);
    return s;
  }

  void build(const PlaneShape& planes) {
    systems_.assign(windows_.size(), {});
    solved_.assign(windows_.size(), {});
    parallel_.for_blocks(windows_.size(), 1, [&](std::size_t w, std::size_t, std::size_t) {
      systems_[w] = make_plane_system(windows_[w], errors_, planes, config_.correlated_points);
      solved_[w] = systems_[w].eliminate_poses();
    });
  }

  void move(const Eigen::VectorXd& step) {
    for (std::size_t w = 0; w < windows_.size(); ++w) {
      const Eigen::VectorXd poses =
          systems_[w].poses.ldlt().solve(systems_[w].pose_gradient) - solved_[w].transpose() * step;
      for (std::size_t s = 1; s < windows_[w].size(); ++s) {
        Pose& pose = windows_[w][s].map_from_sensor;
        pose = se3_exp(poses.segment<6>(6 * static_cast<Eigen::Index>(s - 1))) * pose;
      }
    }
    errors_.values += step;
  }

  /// Covariance: the larger of what the residuals' noise gives, and of what the windows' disagreement does.
  Eigen::MatrixXd covariance(const Eigen::MatrixXd& prior, Eigen::MatrixXd& scatter) const {
    Eigen::MatrixXd information = prior;
    for (const PlaneSystem& s : systems_) information += s.errors;
    const Eigen::MatrixXd inverse =
        information.ldlt().solve(Eigen::MatrixXd::Identity(information.rows(), information.cols()));
    scatter = Eigen::MatrixXd::Zero(information.rows(), information.cols());
    Eigen::VectorXd mean = Eigen::VectorXd::Zero(information.rows());
    const auto n = static_cast<double>(systems_.size());
    for (const PlaneSystem& s : systems_) mean += s.error_gradient / n;
    for (const PlaneSystem& s : systems_) {
      const Eigen::VectorXd influence = inverse * (s.error_gradient - mean);
      scatter += influence * influence.transpose();
    }
    if (n > 1.0) scatter *= n / (n - 1.0);
    return inverse;
  }

  void report(const Eigen::MatrixXd& prior, CalibrationEstimate& out) const {
    Eigen::MatrixXd scatter;
    const Eigen::MatrixXd noise = covariance(prior, scatter);
    const auto deviation = [&](const Eigen::VectorXd& direction) {
      return std::sqrt(std::max(direction.dot(noise * direction), direction.dot(scatter * direction)));
    };
    const auto unit = [&](Eigen::Index i) -> Eigen::VectorXd {
      return Eigen::VectorXd::Unit(errors_.values.size(), i);
    };
    out.windows = windows_.size();
    out.thickness_after_m = thickness();
    out.rings.resize(errors_.rings());
    for (const PlaneSystem& s : systems_) {
      out.patches += s.patches;
      for (std::size_t r = 0; r < out.rings.size(); ++r) out.rings[r].points += s.ring_points[r];
    }
    Eigen::VectorXd seen = Eigen::VectorXd::Zero(errors_.values.size());
    for (std::size_t r = 0; r < out.rings.size(); ++r) {
      RingEstimate& ring = out.rings[r];
      ring.angle_deg = errors_.values[errors_.angle(r)] / kDegree;
      ring.angle_sd_deg = deviation(unit(errors_.angle(r))) / kDegree;
      ring.range_m = errors_.values[errors_.range(r)];
      ring.range_sd_m = deviation(unit(errors_.range(r)));
      ring.angle_known = ring.angle_sd_deg <= config_.angle_limit_deg;
      ring.range_known = ring.range_sd_m <= config_.range_limit_m;
      if (ring.points >= kFewestPoints) seen[errors_.angle(r)] = 1.0;
    }
    if (seen.sum() == 0.0) seen.head(static_cast<Eigen::Index>(errors_.rings())).setOnes();
    seen /= seen.sum();
    out.bias_deg = seen.dot(errors_.values) / kDegree;
    out.bias_sd_deg = deviation(seen) / kDegree;
  }

  std::vector<CalibrationWindow>& windows_;
  const CalibrationConfig& config_;
  const Parallel& parallel_;
  SensorErrors errors_;
  std::vector<PlaneSystem> systems_;
  std::vector<Eigen::MatrixXd> solved_;  // cross^T poses^-1, of each window
};

}  // namespace

CalibrationEstimate calibrate(std::vector<CalibrationWindow>& windows, std::size_t rings,
                              const CalibrationConfig& config, const Parallel& parallel) {
  return Calibration(windows, rings, config, parallel).run();
}

std::string doubt_about(const CalibrationEstimate& estimate, const CalibrationConfig& config) {
  if (estimate.windows < kFewestWindows)
    return "the sensor moves too little: " + std::to_string(estimate.windows) +
           " stretches see surfaces from places apart, " + std::to_string(kFewestWindows) + " are needed";
  if (!(estimate.bias_sd_deg <= config.bias_limit_deg))
    return fmt::format(
        "the common vertical angle is known to {:.3f} degrees only (standard deviation), {:.3f} are needed",
        estimate.bias_sd_deg, config.bias_limit_deg);
  if (!estimate.settled) return "the estimate does not settle";
  return "";
}

}  // namespace hp2
