#include "frontend/hybrid_icp.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace hp2 {
namespace {

constexpr std::size_t kBlock =
    512;  // source points a block; fixed, so that sums do not depend on the threads

class Stopwatch {
 public:
  // Milliseconds since the last call (or construction).
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

// IRLS weight of the Geman-McClure loss rho(e) = e^2 / (e^2 + c^2), up to the constant factor 2.
double robust_weight(double squared_error, double c2) {
  const double d = squared_error + c2;
  return c2 / (d * d);
}

constexpr float kEmptyMove = 0.2F;  // of a voxel
constexpr double kResidual =
    0.2;  // [m], what counts as a residual's deviation, correlation between points included

// Eigenvalues of an information matrix whose rotations are scaled to metres by `lever`, and the step that it
// gives in its observed directions only.
struct Step {
  Vector6d x;
  double min_eigenvalue_ratio;
  int unobserved;
};

Step solve(const Matrix6d& information, const Vector6d& gradient, double lever, double min_ratio) {
  Vector6d scale;
  scale << 1.0, 1.0, 1.0, 1.0 / lever, 1.0 / lever, 1.0 / lever;
  const Matrix6d scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scaled);
  const double largest = eigen.eigenvalues()[5];
  Step step{Vector6d::Zero(), 0.0, 6};
  if (!(largest > 0.0)) return step;
  step.min_eigenvalue_ratio = std::max(0.0, eigen.eigenvalues()[0] / largest);
  step.unobserved = 0;
  const Vector6d projected = eigen.eigenvectors().transpose() * (scale.asDiagonal() * gradient);
  Vector6d y = Vector6d::Zero();
  for (int i = 0; i < 6; ++i) {
    if (eigen.eigenvalues()[i] < min_ratio * largest) {
      ++step.unobserved;
    } else {
      y[i] = -projected[i] / eigen.eigenvalues()[i];
    }
  }
  step.x = scale.asDiagonal() * (eigen.eigenvectors() * y);
  return step;
}

}  // namespace

void HybridIcp::search(const LocalMap& map, const std::vector<Eigen::Vector3f>& source,
                       const Pose& local_from_source, const Parallel& parallel) {
  const Eigen::Matrix3f r = local_from_source.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = local_from_source.translation.cast<float>();
  const auto edge = static_cast<float>(map.voxel_size_m());
  const float inverse_edge = 1.0F / edge;
  parallel.for_blocks(source.size(), kBlock, [&](std::size_t, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      Correspondence& c = correspondences_[i];
      const Eigen::Vector3f p = r * source[i] + t;
      if (c.other_distance >= 0.0F) {
        // The last answer stands while no other point can have become nearer than the one it named; that
        // there was none stands until the point has moved by a part of a voxel.
        const float moved = (p - c.searched_at).norm();
        if (c.voxel < 0 && moved < kEmptyMove * edge) continue;
        const float distance = c.voxel >= 0 ? (p - c.target).norm() : c.other_distance;
        if (distance <= c.other_distance - moved) continue;
      }
      VoxelPoint at;
      for (int a = 0; a < 3; ++a) {
        const auto v = static_cast<int>(std::floor(p[a] * inverse_edge));
        at.voxel[a] = v + origin_[a];
        at.offset[a] = p[a] - static_cast<float>(v) * edge;
      }
      const NearestPoint nearest = map.nearest(at);
      c.searched_at = p;
      c.other_distance = nearest.other_distance_m;
      c.voxel = nearest.voxel;
      if (nearest.voxel >= 0) {
        c.target = (map.voxel_coordinates(nearest.voxel) - origin_).cast<float>() * edge +
                   map.point_offset(nearest.voxel, nearest.slot);
        c.fresh = true;
      }
    }
  });
}

void HybridIcp::classify(LocalMap& map, const Parallel& parallel) {
  ++epoch_;
  stale_.clear();
  for (const Correspondence& c : correspondences_) {
    if (!c.fresh || !map.planarity_stale(c.voxel)) continue;
    const auto v = static_cast<std::size_t>(c.voxel);
    if (v >= listed_.size()) listed_.resize(v + v / 2 + 1024, 0);
    if (listed_[v] == epoch_) continue;
    listed_[v] = epoch_;
    stale_.push_back(c.voxel);
  }
  parallel.for_blocks(stale_.size(), 64, [&](std::size_t, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) map.update_planarity(stale_[i]);
  });
  const auto n_min = static_cast<float>(config_.n_min);
  for (Correspondence& c : correspondences_) {
    if (!c.fresh) continue;
    c.fresh = false;
    c.normal.setZero();
    if (config_.mode == IcpMode::kPointToPoint) continue;
    const Planarity& shape = map.planarity(c.voxel);
    if (shape.n < n_min) continue;
    double tau = 1.0;
    if (config_.mode == IcpMode::kFixedThreshold) {
      tau = config_.tau_ref;
    } else if (config_.mode != IcpMode::kPointToPlane) {
      tau = adaptive_threshold(static_cast<double>(shape.n), config_.tau_ref, config_.n_ref, config_.tau_min,
                               config_.tau_max);
    }
    if (static_cast<double>(shape.score) < tau) c.normal = shape.normal;
  }
}

NormalEquations HybridIcp::accumulate(const std::vector<Eigen::Vector3f>& source,
                                      const Pose& local_from_source, double sigma, double max_distance,
                                      const Parallel& parallel) {
  const Eigen::Matrix3d r = local_from_source.rotation.toRotationMatrix();
  const Eigen::Vector3d t = local_from_source.translation;
  const double c2 = sigma * sigma;
  const double max2 = max_distance * max_distance;
  const bool plane_only = config_.mode == IcpMode::kPointToPlane;
  const bool in_plane = config_.mode == IcpMode::kRobust;
  partial_.assign(Parallel::block_count(source.size(), kBlock), NormalEquations());
  parallel.for_blocks(source.size(), kBlock, [&](std::size_t block, std::size_t begin, std::size_t end) {
    NormalEquations sums;
    for (std::size_t i = begin; i < end; ++i) {
      const Correspondence& c = correspondences_[i];
      if (c.voxel < 0) continue;
      const Eigen::Vector3d p = r * source[i].cast<double>() + t;
      const Eigen::Vector3d residual = p - c.target.cast<double>();
      const double squared = residual.squaredNorm();
      if (squared > max2) continue;
      const Eigen::Vector3d n = c.normal.cast<double>();
      const double e = n.dot(residual);
      constexpr double kFit2 = 0.2 * 0.2;
      sums.fit += kFit2 / (kFit2 + (c.normal != Eigen::Vector3f::Zero() ? e * e : squared));
      if (c.normal != Eigen::Vector3f::Zero()) {
        sums.planar.add(p, n, e, robust_weight(e * e, c2));
        if (in_plane) sums.planar_points.add(p, residual, robust_weight(squared, c2));
      } else if (!plane_only) {
        sums.non_planar.add(p, residual, robust_weight(squared, c2));
      }
    }
    partial_[block] = sums;
  });
  NormalEquations total;
  for (const auto& p : partial_) total.add(p);
  return total;
}

Matrix6d HybridIcp::balance(const NormalEquations& sums, Vector6d& gradient) const {
  const int planar = sums.planar.count, others = sums.non_planar.count;
  double alpha = planar + others > 0 ? static_cast<double>(planar) / (planar + others) : 0.0;
  switch (config_.mode) {
    case IcpMode::kPointToPoint:
      alpha = 0.0;
      break;
    case IcpMode::kPointToPlane:
      alpha = 1.0;
      break;
    case IcpMode::kFixedAlpha:
      alpha = 0.5;
      break;
    case IcpMode::kRobust: {
      const double b = config_.in_plane_weight * alpha;
      gradient = alpha * sums.planar.gradient() + b * sums.planar_points.gradient() +
                 (1.0 - alpha) * sums.non_planar.gradient();
      return alpha * sums.planar.information() + b * sums.planar_points.information() +
             (1.0 - alpha) * sums.non_planar.information();
    }
    default:
      break;
  }
  gradient = alpha * sums.planar.gradient() + (1.0 - alpha) * sums.non_planar.gradient();
  return alpha * sums.planar.information() + (1.0 - alpha) * sums.non_planar.information();
}

IcpResult HybridIcp::align(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                           double sigma_m, const Parallel& parallel, const PosePrior* prior) {
  IcpResult result;
  result.map_from_source = guess;
  if (map.empty() || source.empty()) return result;
  // All sums are taken about a voxel corner near the sensor: well conditioned, and floats keep their digits.
  origin_ = map.locate(guess.translation).voxel;
  const Eigen::Vector3d origin = origin_.cast<double>() * map.voxel_size_m();
  Pose local(guess.rotation, guess.translation - origin);
  correspondences_.assign(source.size(), Correspondence());
  double lever2 = 0.0;
  for (const auto& p : source) lever2 += static_cast<double>(p.squaredNorm());
  const double lever = std::sqrt(std::max(1e-6, lever2 / static_cast<double>(source.size())));

  result.mean_range_m = lever;
  const double max_distance = 3.0 * sigma_m;
  Stopwatch watch;
  NormalEquations sums;
  Matrix6d information = Matrix6d::Zero();
  for (result.iterations = 1; result.iterations <= config_.max_iterations; ++result.iterations) {
    watch.lap();
    search(map, source, local, parallel);
    result.ms_search += watch.lap();
    classify(map, parallel);
    result.ms_planarity += watch.lap();
    sums = accumulate(source, local, sigma_m, max_distance, parallel);
    Vector6d gradient;
    information = balance(sums, gradient);
    Matrix6d total = information;
    if (prior != nullptr && config_.mode == IcpMode::kRobust) {
      const Pose expected(prior->map_from_source.rotation, prior->map_from_source.translation - origin);
      Matrix6d to_source = Matrix6d::Identity();  // increments about the local origin -> about the source's
      to_source.topRightCorner<3, 3>() = -skew(local.translation);
      // The robust weights make the scan's sums speak as if its residuals' deviation were sigma; it is
      // kResidual.
      const Matrix6d weight = (kResidual * kResidual / (sigma_m * sigma_m)) *
                              (to_source.transpose() * prior->information * to_source);
      total += weight;
      gradient += weight * se3_log(local * expected.inverse());
    }
    const Step step = solve(total, gradient, lever, config_.min_eigenvalue_ratio);
    result.min_eigenvalue_ratio = step.min_eigenvalue_ratio;
    result.unobserved_directions = step.unobserved;
    local = se3_exp(step.x) * local;
    result.ms_solve += watch.lap();
    if (step.x.norm() < config_.convergence_m) {
      result.converged = true;
      break;
    }
  }
  result.iterations = std::min(result.iterations, config_.max_iterations);
  result.n_planar = sums.planar.count;
  result.n_non_planar = sums.non_planar.count;
  const int count = result.n_planar + result.n_non_planar;
  const double weight = sums.planar.information().topLeftCorner<3, 3>().trace() + sums.non_planar.w;
  result.rms_m = weight > 0.0 ? std::sqrt((sums.planar.squares + sums.non_planar.squares) / weight) : 0.0;
  result.fit = sums.fit / static_cast<double>(source.size());
  result.inlier_ratio = static_cast<double>(count) / static_cast<double>(source.size());
  // About the source's origin instead of the local one: x_local = x_source + phi cross t.
  Matrix6d shift = Matrix6d::Identity();
  shift.topRightCorner<3, 3>() = -skew(local.translation);
  result.information = shift.inverse().transpose() * information * shift.inverse();
  result.map_from_source = Pose(local.rotation, local.translation + origin);
  return result;
}

}  // namespace hp2
