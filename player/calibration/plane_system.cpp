#include "player/calibration/plane_system.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Cholesky>

#include "frontend/odometry/deskew.hpp"
#include "player/calibration/plane_patches.hpp"

namespace hp2 {
namespace {

constexpr double kSteepest = 8.0;   // tan(incidence) up to which a spot's length matters
constexpr double kFlattest = 0.02;  // cosine of the incidence, for where a ray meets a plane
constexpr double kRobust = 1.5;     // deviations at which a residual's weight is a quarter
constexpr double kLeastDeviation_m = 2e-3;
constexpr double kPoseDeviation_m = 0.5;  // poses are known that well before; only against singularity
constexpr double kPoseDeviation_rad = 0.05;

using PatchVector = Eigen::Vector3d;  // of a patch: offset along the normal, tilts

/// A point in the window's frame and what moves it.
struct PlacedPoint {
  Eigen::Vector3d position, ray, raised, turned;  // [m]; the ray and its change per rad of each angle
  double range_m = 0.0;
  std::uint16_t scan = 0;
  std::int16_t ring = 0;
};

class Placement {
 public:
  Placement(const CalibrationScan& scan, std::uint16_t number, const SensorErrors& errors)
      : scan_(scan), number_(number), errors_(errors), deskew_(scan.sweep_twist) {
    rotation_ = scan.map_from_sensor.rotation.toRotationMatrix();
  }

  PlacedPoint operator()(const CalibrationPoint& point) const {
    const auto ring = static_cast<std::size_t>(point.ring);
    const Eigen::Vector3d p = point.position.cast<double>();
    const double horizontal = std::hypot(p.x(), p.y());
    const double up = std::atan2(p.z(), horizontal) + errors_.values[errors_.angle(ring)];
    const double around = std::atan2(p.y(), p.x()) + errors_.values[errors_.azimuth(ring)];
    PlacedPoint out;
    out.scan = number_;
    out.ring = point.ring;
    out.range_m = p.norm() - errors_.values[errors_.range(ring)];
    const Eigen::Vector3d ray(std::cos(up) * std::cos(around), std::cos(up) * std::sin(around), std::sin(up));
    const Eigen::Vector3d raised(-std::sin(up) * std::cos(around), -std::sin(up) * std::sin(around),
                                 std::cos(up));
    const Eigen::Vector3f at = (out.range_m * ray).cast<float>();
    const Eigen::Vector3f moved = deskew_(at, point.time);
    const auto turned = [&](const Eigen::Vector3d& direction) -> Eigen::Vector3d {
      const Eigen::Vector3f end = at + direction.cast<float>();
      return rotation_ * (deskew_(end, point.time) - moved).cast<double>();
    };
    out.position = scan_.map_from_sensor * moved.cast<double>();
    out.ray = turned(ray);
    out.raised = turned(raised);
    out.turned = std::cos(up) * turned({-std::sin(around), std::cos(around), 0.0});
    return out;
  }

 private:
  const CalibrationScan& scan_;
  std::uint16_t number_;
  const SensorErrors& errors_;
  Deskew deskew_;
  Eigen::Matrix3d rotation_;
};

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// One residual with its derivatives; `columns` of the whole system (poses, then errors).
struct Residual {
  double value = 0.0;
  std::array<Eigen::Index, 10> columns{};
  std::array<double, 10> derivatives{};
  PatchVector by_patch;
};

class SystemBuilder {
 public:
  SystemBuilder(const CalibrationWindow& window, const SensorErrors& errors)
      : window_(window), errors_(errors), pose_count_(6 * static_cast<Eigen::Index>(window.size() - 1)) {
    const Eigen::Index n = pose_count_ + errors.values.size();
    information_ = Eigen::MatrixXd::Zero(n, n);
    gradient_ = Eigen::VectorXd::Zero(n);
  }

  PlaneSystem run(const PlaneShape& shape, double correlated_points) {
    place();
    find(shape);
    std::vector<double> distances;
    for (const PlanePatch& patch : patches_)
      for (const std::uint32_t m : patch.members)
        distances.push_back(std::abs(residual(patch, points_[m]).value));
    PlaneSystem out;
    out.thickness_m = median(distances);
    deviation_m_ = std::max(1.4826 * out.thickness_m, kLeastDeviation_m);
    weight_ = 1.0 / (deviation_m_ * deviation_m_ * correlated_points);
    out.ring_points.assign(errors_.rings(), 0);
    for (const PlanePatch& patch : patches_) {
      add(patch);
      for (const std::uint32_t m : patch.members)
        ++out.ring_points[static_cast<std::size_t>(points_[m].ring)];
    }
    out.patches = patches_.size();
    for (Eigen::Index i = 0; i < pose_count_; ++i) {
      const double deviation = i % 6 < 3 ? kPoseDeviation_m : kPoseDeviation_rad;
      information_(i, i) += 1.0 / (deviation * deviation);
    }
    const Eigen::Index n_errors = errors_.values.size();
    out.poses = information_.topLeftCorner(pose_count_, pose_count_);
    out.cross = information_.topRightCorner(pose_count_, n_errors);
    out.errors = information_.bottomRightCorner(n_errors, n_errors);
    out.pose_gradient = gradient_.head(pose_count_);
    out.error_gradient = gradient_.tail(n_errors);
    return out;
  }

 private:
  void place() {
    for (std::size_t s = 0; s < window_.size(); ++s) {
      const Placement place(window_[s], static_cast<std::uint16_t>(s), errors_);
      for (const CalibrationPoint& point : window_[s].points) points_.push_back(place(point));
    }
  }

  void find(const PlaneShape& shape) {
    std::vector<PatchPoint> points;
    points.reserve(points_.size());
    for (std::uint32_t i = 0; i < points_.size(); ++i)
      points.push_back({points_[i].position, i, points_[i].scan});
    PatchConfig config;
    config.thickness = shape.thickness;
    config.thickest_m = shape.thickest_m;
    patches_ = find_patches(points, config);
  }

  Residual residual(const PlanePatch& patch, const PlacedPoint& p) const {
    const Eigen::Vector3d& n = patch.normal;
    const double facing = n.dot(p.ray);
    const double cosine = std::max(std::abs(facing), 1e-3);
    const double slope = std::min(std::sqrt(std::max(1.0 - cosine * cosine, 0.0)) / cosine, kSteepest);
    // Derivatives are those at the place where the ray meets the plane. At the point itself they would hold
    // its noise, and whatever brings the scene nearer would look better: a vertical shrinking above all.
    const double early =
        n.dot(p.position - patch.centre) / std::copysign(std::max(cosine, kFlattest), facing);
    const Eigen::Vector3d on_plane = p.position - early * p.ray;
    const double range_m = p.range_m - early;
    const Eigen::Vector3d off = on_plane - patch.centre;
    const Eigen::Vector3d by_turn = on_plane.cross(n);
    const double by_grazing = facing * range_m * slope;
    const auto ring = static_cast<std::size_t>(p.ring);
    Residual r;
    r.value = n.dot(p.position - patch.centre) + errors_.values[errors_.grazing()] * by_grazing;
    const Eigen::Index pose = 6 * (static_cast<Eigen::Index>(p.scan) - 1);
    for (Eigen::Index k = 0; k < 6; ++k) {
      const auto at = static_cast<std::size_t>(k);
      r.columns[at] = p.scan > 0 ? pose + k : Eigen::Index{0};
      if (p.scan > 0) r.derivatives[at] = k < 3 ? n[k] : by_turn[k - 3];
    }
    const std::array<Eigen::Index, 4> columns{errors_.angle(ring), errors_.range(ring), errors_.azimuth(ring),
                                              errors_.grazing()};
    const std::array<double, 4> derivatives{range_m * n.dot(p.raised), -facing, range_m * n.dot(p.turned),
                                            by_grazing};
    for (std::size_t k = 0; k < 4; ++k) {
      r.columns[6 + k] = pose_count_ + columns[k];
      r.derivatives[6 + k] = derivatives[k];
    }
    r.by_patch = {-1.0, -patch.along.dot(off), -patch.across.dot(off)};
    return r;
  }

  /// Adds a patch's residuals, its plane eliminated.
  void add(const PlanePatch& patch) {
    Eigen::Matrix3d plane = Eigen::Matrix3d::Zero();
    PatchVector plane_gradient = PatchVector::Zero();
    cross_.setZero(gradient_.size(), 3);
    touched_.clear();
    for (const std::uint32_t m : patch.members) {
      const Residual r = residual(patch, points_[m]);
      const double ratio = r.value / (kRobust * deviation_m_);
      const double w = weight_ / ((1.0 + ratio * ratio) * (1.0 + ratio * ratio));
      for (std::size_t a = 0; a < r.columns.size(); ++a) {
        const Eigen::Index row = r.columns[a];
        for (std::size_t b = 0; b < r.columns.size(); ++b)
          information_(row, r.columns[b]) += w * r.derivatives[a] * r.derivatives[b];
        gradient_[row] -= w * r.derivatives[a] * r.value;
        cross_.row(row) += w * r.derivatives[a] * r.by_patch.transpose();
        touched_.push_back(row);
      }
      plane += w * r.by_patch * r.by_patch.transpose();
      plane_gradient -= w * r.value * r.by_patch;
    }
    std::sort(touched_.begin(), touched_.end());
    touched_.erase(std::unique(touched_.begin(), touched_.end()), touched_.end());
    plane.diagonal().array() += 1e-6 * plane(0, 0);
    const Eigen::Matrix3d inverse = plane.inverse();
    for (const Eigen::Index a : touched_) {
      const Eigen::RowVector3d left = cross_.row(a) * inverse;
      for (const Eigen::Index b : touched_) information_(a, b) -= left.dot(cross_.row(b));
      gradient_[a] -= left.dot(plane_gradient);
    }
  }

  const CalibrationWindow& window_;
  const SensorErrors& errors_;
  Eigen::Index pose_count_;
  std::vector<PlacedPoint> points_;
  std::vector<PlanePatch> patches_;
  double deviation_m_ = 1.0, weight_ = 1.0;
  Eigen::MatrixXd information_;
  Eigen::VectorXd gradient_;
  Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor> cross_;  // of the patch being added
  std::vector<Eigen::Index> touched_;
};

}  // namespace

SensorErrors::SensorErrors(std::size_t rings)
    : values(Eigen::VectorXd::Zero(static_cast<Eigen::Index>(3 * rings + 1))) {}

Eigen::MatrixXd PlaneSystem::eliminate_poses() {
  const Eigen::MatrixXd solved = poses.ldlt().solve(cross);
  errors -= cross.transpose() * solved;
  error_gradient -= solved.transpose() * pose_gradient;
  return solved.transpose();
}

PlaneSystem make_plane_system(const CalibrationWindow& window, const SensorErrors& errors,
                              const PlaneShape& shape, double correlated_points) {
  return SystemBuilder(window, errors).run(shape, correlated_points);
}

}  // namespace hp2
