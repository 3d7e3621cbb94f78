#include "common/evaluation/metrics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>

#include "common/config.hpp"
#include "common/error.hpp"
#include "common/text.hpp"

namespace hp2 {

namespace {

constexpr double kDegrees = 180.0 / M_PI;
constexpr std::array<double, 8> kKittiLengths_m{100, 200, 300, 400, 500, 600, 700, 800};

Eigen::Vector3d position(const Eigen::Matrix4d& m) { return m.topRightCorner<3, 1>(); }

std::vector<Eigen::Vector3d> positions(const Trajectory& trajectory) {
  std::vector<Eigen::Vector3d> out;
  for (const auto& pose : trajectory.poses) out.push_back(position(pose));
  return out;
}

// evo's se3_inverse: the transposed rotation, although that of a rounded matrix is not quite the inverse.
Eigen::Matrix4d transposed_inverse(const Eigen::Matrix4d& m) {
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = m.topLeftCorner<3, 3>().transpose();
  out.topRightCorner<3, 1>() = -(out.topLeftCorner<3, 3>() * position(m));
  return out;
}

void check_pairs(const Trajectory& reference, const Trajectory& estimate) {
  if (reference.size() != estimate.size() || reference.size() == 0) {
    throw Error("the trajectories are not paired", "evaluation", "Call associate() first.");
  }
}

nlohmann::ordered_json to_json(const ErrorStatistics& s) {
  return {{"rmse", s.rmse}, {"mean", s.mean}, {"median", s.median}, {"std", s.std},
          {"min", s.min},   {"max", s.max},   {"sse", s.sse},       {"n", s.n}};
}

}  // namespace

ErrorStatistics statistics(const std::vector<double>& errors) {
  ErrorStatistics s;
  if (errors.empty()) return s;
  s.n = errors.size();
  std::vector<double> sorted = errors;
  std::sort(sorted.begin(), sorted.end());
  const double n = static_cast<double>(s.n);
  for (const double e : errors) {
    s.mean += e / n;
    s.sse += e * e;
  }
  for (const double e : errors) s.std += (e - s.mean) * (e - s.mean) / n;
  s.std = std::sqrt(s.std);
  s.rmse = std::sqrt(s.sse / n);
  s.min = sorted.front();
  s.max = sorted.back();
  s.median = 0.5 * (sorted[(s.n - 1) / 2] + sorted[s.n / 2]);
  return s;
}

Alignment parse_alignment(const std::string& word) {
  if (word == "se3") return Alignment::kSe3;
  if (word == "origin") return Alignment::kOrigin;
  if (word == "none") return Alignment::kNone;
  throw Error("unknown alignment \"" + word + "\"", "--align", did_you_mean(word, {"se3", "origin", "none"}));
}

Eigen::Matrix4d umeyama_se3(const std::vector<Eigen::Vector3d>& reference,
                            const std::vector<Eigen::Vector3d>& estimate) {
  const double n = static_cast<double>(reference.size());
  Eigen::Vector3d reference_mean = Eigen::Vector3d::Zero(), estimate_mean = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < reference.size(); ++i) {
    reference_mean += reference[i] / n;
    estimate_mean += estimate[i] / n;
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < reference.size(); ++i) {
    covariance += (reference[i] - reference_mean) * (estimate[i] - estimate_mean).transpose() / n;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  // Umeyama (1991), eq. 38 to 43: of rank 2 or more, or else a rotation about the line stays open.
  if (reference.size() < 3 || svd.singularValues()[1] < std::numeric_limits<double>::epsilon()) {
    throw Error("the SE(3) alignment is not determined",
                std::to_string(reference.size()) + " pairs of positions",
                "They must not lie on one line or point: use --align origin.");
  }
  Eigen::Vector3d sign(1, 1, 1);
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign[2] = -1;
  Eigen::Matrix4d out = Eigen::Matrix4d::Identity();
  out.topLeftCorner<3, 3>() = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  out.topRightCorner<3, 1>() = reference_mean - out.topLeftCorner<3, 3>() * estimate_mean;
  return out;
}

Eigen::Matrix4d alignment_transform(const Trajectory& reference, const Trajectory& estimate,
                                    Alignment alignment) {
  check_pairs(reference, estimate);
  if (alignment == Alignment::kSe3) return umeyama_se3(positions(reference), positions(estimate));
  if (alignment == Alignment::kOrigin) {
    return reference.poses.front() * transposed_inverse(estimate.poses.front());
  }
  return Eigen::Matrix4d::Identity();
}

Trajectory transformed(const Eigen::Matrix4d& transform, const Trajectory& trajectory) {
  Trajectory out = trajectory;
  for (auto& pose : out.poses) pose = transform * pose;
  return out;
}

std::vector<double> absolute_errors(const Trajectory& reference, const Trajectory& estimate) {
  check_pairs(reference, estimate);
  std::vector<double> errors;
  for (std::size_t i = 0; i < reference.size(); ++i) {
    errors.push_back((position(estimate.poses[i]) - position(reference.poses[i])).norm());
  }
  return errors;
}

RelativeErrors relative_errors(const Trajectory& reference, const Trajectory& estimate, std::size_t delta,
                               bool all_pairs) {
  check_pairs(reference, estimate);
  if (delta == 0) throw Error("the distance of a pair is 0", "relative error", "Use 1 pose or more.");
  RelativeErrors errors;
  for (std::size_t i = 0; i + delta < reference.size(); i += all_pairs ? 1 : delta) {
    const Eigen::Matrix4d a = transposed_inverse(reference.poses[i]) * reference.poses[i + delta];
    const Eigen::Matrix4d b = transposed_inverse(estimate.poses[i]) * estimate.poses[i + delta];
    const Eigen::Matrix4d error = transposed_inverse(a) * b;
    const Eigen::Quaterniond rotation(Eigen::Matrix3d(error.topLeftCorner<3, 3>()));
    errors.translation_m.push_back(position(error).norm());
    errors.rotation_deg.push_back(rotation_angle(rotation.normalized()) * kDegrees);
  }
  return errors;
}

KittiError kitti_error(const Trajectory& reference, const Trajectory& estimate, std::size_t step) {
  check_pairs(reference, estimate);
  std::vector<double> path_m{0.0};
  for (std::size_t i = 1; i < reference.size(); ++i) {
    path_m.push_back(path_m.back() +
                     (position(reference.poses[i]) - position(reference.poses[i - 1])).norm());
  }
  KittiError result;
  double translation = 0, rotation = 0;
  for (std::size_t first = 0; first < reference.size(); first += std::max<std::size_t>(step, 1)) {
    for (const double length : kKittiLengths_m) {
      const auto end = std::upper_bound(path_m.begin() + static_cast<std::ptrdiff_t>(first), path_m.end(),
                                        path_m[first] + length);
      if (end == path_m.end()) break;
      const auto last = static_cast<std::size_t>(end - path_m.begin());
      const Eigen::Matrix4d a = reference.poses[first].inverse() * reference.poses[last];
      const Eigen::Matrix4d b = estimate.poses[first].inverse() * estimate.poses[last];
      const Eigen::Matrix4d error = b.inverse() * a;
      const double cosine = 0.5 * (error.topLeftCorner<3, 3>().trace() - 1.0);
      rotation += std::acos(std::max(std::min(cosine, 1.0), -1.0)) / length;
      translation += position(error).norm() / length;
      ++result.segments;
    }
  }
  const double n = static_cast<double>(result.segments);
  const double nothing = std::numeric_limits<double>::quiet_NaN();
  result.t_percent = result.segments == 0 ? nothing : 100.0 * translation / n;
  result.r_deg_per_100m = result.segments == 0 ? nothing : 100.0 * kDegrees * rotation / n;
  return result;
}

Evaluation evaluate(const Trajectory& reference, const Trajectory& estimate, Alignment alignment,
                    std::size_t rpe_delta) {
  Evaluation out;
  out.reference = reference;
  out.aligned = transformed(alignment_transform(reference, estimate, alignment), estimate);
  out.ate_errors = absolute_errors(reference, out.aligned);
  out.ate = statistics(out.ate_errors);
  const RelativeErrors relative = relative_errors(reference, estimate, rpe_delta);
  out.rpe_translation = statistics(relative.translation_m);
  out.rpe_rotation_deg = statistics(relative.rotation_deg);
  out.kitti = kitti_error(reference, estimate);
  return out;
}

nlohmann::ordered_json to_json(const Evaluation& e) {
  nlohmann::ordered_json kitti{
      {"t_percent", nullptr}, {"r_deg_per_100m", nullptr}, {"segments", e.kitti.segments}};
  if (e.kitti.segments > 0) {
    kitti["t_percent"] = e.kitti.t_percent;
    kitti["r_deg_per_100m"] = e.kitti.r_deg_per_100m;
  }
  return {{"ate", to_json(e.ate)},
          {"rpe_translation", to_json(e.rpe_translation)},
          {"rpe_rotation_deg", to_json(e.rpe_rotation_deg)},
          {"kitti", kitti}};
}

}  // namespace hp2
