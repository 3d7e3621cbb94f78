#include "frontend/hybrid_icp.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <Eigen/Eigenvalues>

namespace hp2 {
namespace {

// Source points a block; fixed, so that sums do not depend on the threads.
constexpr std::size_t kBlock = PlaneBatch::kMost;

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
float robust_weight(float squared_error, float c2) {
  const float d = squared_error + c2;
  return c2 / (d * d);
}

constexpr std::size_t kAhead = 6;        // queries that the memory is asked for before their turn
constexpr std::size_t kFewPoints = 800;  // are enough to tell a long step's direction
// An answer of the search is to stand while the point moves by this much [m]: some steps, within bounds.
constexpr float kMarginSteps = 5.0F, kLeastMargin = 0.04F, kMostMargin = 0.15F;
constexpr float kFit2 = 0.5F * 0.5F;  // [m^2], scale of IcpResult::fit
constexpr float kEmptyMove = 0.2F;    // of a voxel
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

void HybridIcp::search(const LocalMap& map, const Selection& source, const Pose& local_from_source,
                       Part& part) {
  const Eigen::Matrix3f r = local_from_source.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = local_from_source.translation.cast<float>();
  const auto edge = static_cast<float>(map.voxel_size_m());
  const float inverse_edge = 1.0F / edge;
  part.fresh.clear();
  part.probes.clear();
  LocalMap::Cursor cursor;
  for (std::size_t i = source.begin; i < source.end; i += source.stride) {
    Correspondence& c = correspondences_[i];
    const Eigen::Vector3f p = r * source.points[i] + t;
    if (c.other_distance >= 0.0F) {
      // The last answer stands while no other point can have become nearer than the one it named; that
      // there was none stands until the point has moved by a part of a voxel.
      const float moved = (p - c.searched_at).norm();
      if (c.voxel < 0 && moved < kEmptyMove * edge) continue;
      const float distance = c.voxel >= 0 ? (p - c.target).norm() : c.other_distance;
      if (distance <= c.other_distance - moved) continue;
    }
    c.searched_at = p;
    part.fresh.push_back(static_cast<std::uint32_t>(i));
    part.probes.push_back(map.probe(locate_near(p, origin_, edge, inverse_edge), cursor));
  }
  const std::size_t n = part.probes.size();
  for (std::size_t k = 0; k < std::min(kAhead, n); ++k) map.look_around(part.probes[k]);
  std::size_t found = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (k + kAhead < n) map.look_around(part.probes[k + kAhead]);
    const LocalMap::Probe& probe = part.probes[k];
    Correspondence& c = correspondences_[part.fresh[k]];
    const NearestPoint nearest = map.nearest(probe, margin_m_);
    c.other_distance = nearest.other_distance_m;
    c.voxel = nearest.voxel;
    if (nearest.voxel < 0) continue;
    c.target = c.searched_at - probe.at.offset + nearest.offset;
    part.fresh[found++] = part.fresh[k];
  }
  part.fresh.resize(found);
}

// The map's answer, or one of our own where that is stale. Neighbours in a sweep ask for the same voxel in
// turn.
const Planarity& HybridIcp::shape_of(const LocalMap& map, std::int32_t voxel, Part& part) {
  if (!map.planarity_stale(voxel)) return map.planarity(voxel);
  std::uint32_t& recent = part.recent[static_cast<std::uint32_t>(voxel) % part.recent.size()];
  if (recent >= part.planarities.size() || part.planarities[recent].first != voxel) {
    recent = static_cast<std::uint32_t>(part.planarities.size());
    part.planarities.emplace_back(voxel, analyse(map.neighbourhood_moments(voxel)));
  }
  return part.planarities[recent].second;
}

void HybridIcp::classify(const LocalMap& map, Part& part) {
  part.planarities.clear();
  const auto n_min = static_cast<float>(config_.n_min);
  for (const std::uint32_t i : part.fresh) {
    Correspondence& c = correspondences_[i];
    c.normal.setZero();
    if (config_.mode == IcpMode::kPointToPoint) continue;
    const Planarity& shape = shape_of(map, c.voxel, part);
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

void HybridIcp::accumulate(const Selection& source, const Pose& local_from_source, double sigma_m,
                           Part& part) const {
  const Eigen::Matrix3f r = local_from_source.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = local_from_source.translation.cast<float>();
  const auto c2 = static_cast<float>(sigma_m * sigma_m);
  const float max2 = 9.0F * c2;
  const bool plane_only = config_.mode == IcpMode::kPointToPlane;
  NormalEquations& sums = part.sums;
  sums = NormalEquations();
  PlaneBatch planes;
  PointBatch points, plane_points;
  float fit = 0.0F;
  for (std::size_t i = source.begin; i < source.end; i += source.stride) {
    const Correspondence& c = correspondences_[i];
    if (c.voxel < 0) continue;
    const Eigen::Vector3f p = r * source.points[i] + t;
    const Eigen::Vector3f d = p - c.target;
    const float squared = d.squaredNorm();
    if (squared > max2) continue;
    fit += kFit2 / (kFit2 + squared);
    const Eigen::Vector3f& n = c.normal;
    if (n != Eigen::Vector3f::Zero()) {
      const float e = n.dot(d);
      planes.add({p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), e, robust_weight(e * e, c2)});
      if (in_plane_needed_) {
        plane_points.add({p.x(), p.y(), p.z(), d.x(), d.y(), d.z(), robust_weight(squared, c2)});
      }
    } else if (!plane_only) {
      points.add({p.x(), p.y(), p.z(), d.x(), d.y(), d.z(), robust_weight(squared, c2)});
    }
  }
  sums.fit = static_cast<double>(fit);
  planes.flush(sums.planar);
  points.flush(sums.non_planar);
  if (in_plane_needed_) plane_points.flush(sums.planar_points);
}

// Correspondences and their sums in one pass over the points, block by block while they are in the cache.
NormalEquations HybridIcp::linearise(LocalMap& map, const std::vector<Eigen::Vector3f>& source,
                                     std::size_t stride, const Pose& local_from_source, double sigma_m,
                                     const Parallel& parallel, IcpResult& result) {
  Stopwatch whole;
  const std::size_t span = kBlock * stride;
  const std::size_t parts = Parallel::block_count(source.size(), span);
  if (parts_.size() < parts) parts_.resize(parts);
  parallel.for_blocks(source.size(), span, [&](std::size_t block, std::size_t begin, std::size_t end) {
    Part& part = parts_[block];
    const Selection selection{source, stride, begin, end};
    Stopwatch watch;
    search(map, selection, local_from_source, part);
    part.ms[0] = watch.lap();
    classify(map, part);
    part.ms[1] = watch.lap();
    accumulate(selection, local_from_source, sigma_m, part);
    part.ms[2] = watch.lap();
  });
  NormalEquations total;
  double ms[3] = {};
  for (std::size_t b = 0; b < parts; ++b) {
    const Part& part = parts_[b];
    total.add(part.sums);
    for (const auto& [voxel, planarity] : part.planarities) map.set_planarity(voxel, planarity);
    for (int k = 0; k < 3; ++k) ms[k] += part.ms[k];
  }
  // The threads' times, scaled to what the whole has taken.
  const double scale = whole.lap() / std::max(1e-9, ms[0] + ms[1] + ms[2]);
  result.ms_search += scale * ms[0];
  result.ms_planarity += scale * ms[1];
  result.ms_solve += scale * ms[2];
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
    default:
      break;
  }
  gradient = alpha * sums.planar.gradient() + (1.0 - alpha) * sums.non_planar.gradient();
  return alpha * sums.planar.information() + (1.0 - alpha) * sums.non_planar.information();
}

// A plane says nothing of the motion along itself, so where nearly all is planar some direction is left to a
// few points that alpha has made light: on a bridge, the one along it. There, and only there, the planar
// correspondences' in-plane residuals are heard as well; elsewhere they would hold the sensor to the pattern
// of its own scan lines. Returns the
// smallest eigenvalue as a share of the largest, as it was before.
double HybridIcp::support_weak_directions(const NormalEquations& sums, double lever, Matrix6d& information,
                                          Vector6d& gradient) {
  const int count = sums.planar.count + sums.non_planar.count;
  if (count == 0) return 0.0;
  Vector6d scale;
  scale << 1.0, 1.0, 1.0, 1.0 / lever, 1.0 / lever, 1.0 / lever;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scale.asDiagonal() * information * scale.asDiagonal());
  const double weak = config_.weak_direction_ratio * eigen.eigenvalues()[5];
  // Kept in sight a little longer: the next iteration may find the direction weak again.
  in_plane_needed_ = eigen.eigenvalues()[0] < 2.0 * weak;
  const double largest = eigen.eigenvalues()[5];
  const double ratio = largest > 0.0 ? std::max(0.0, eigen.eigenvalues()[0] / largest) : 0.0;
  if (!(eigen.eigenvalues()[0] < weak)) return ratio;
  const Vector6d share = (1.0 - eigen.eigenvalues().array() / weak).max(0.0).sqrt();
  const Matrix6d part = scale.cwiseInverse().asDiagonal() * eigen.eigenvectors() * share.asDiagonal() *
                        eigen.eigenvectors().transpose() * scale.asDiagonal();
  const double weight = config_.in_plane_weight * sums.planar.count / count;
  information += weight * (part * sums.planar_points.information() * part.transpose());
  gradient += weight * (part * sums.planar_points.gradient());
  return ratio;
}

IcpResult HybridIcp::align(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                           double sigma_m, const Parallel& parallel, const PosePrior* prior) {
  // All sums are taken about a voxel corner near the sensor: well conditioned, and floats keep their digits.
  origin_ = map.locate(guess.translation).voxel;
  correspondences_.assign(source.size(), Correspondence());
  return iterate(map, source, guess, sigma_m, parallel, prior);
}

IcpResult HybridIcp::align_again(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                                 double sigma_m, const Parallel& parallel, const PosePrior* prior) {
  if (correspondences_.size() != source.size()) return align(map, source, guess, sigma_m, parallel, prior);
  return iterate(map, source, guess, sigma_m, parallel, prior);
}

IcpResult HybridIcp::iterate(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                             double sigma_m, const Parallel& parallel, const PosePrior* prior) {
  IcpResult result;
  result.map_from_source = guess;
  if (map.empty() || source.empty()) return result;
  const Eigen::Vector3d origin = origin_.cast<double>() * map.voxel_size_m();
  Pose local(guess.rotation, guess.translation - origin);
  double lever2 = 0.0;
  for (const auto& p : source) lever2 += static_cast<double>(p.squaredNorm());
  const double lever = std::sqrt(std::max(1e-6, lever2 / static_cast<double>(source.size())));
  result.mean_range_m = lever;

  NormalEquations sums;
  Matrix6d information = Matrix6d::Zero();
  in_plane_needed_ = config_.mode == IcpMode::kRobust;  // until the first iteration has told
  // Few points tell a long step's direction as well as many.
  const bool coarse_first = config_.coarse_step_m > 0.0 && source.size() > kFewPoints;
  margin_m_ = kMostMargin;
  std::size_t stride = coarse_first ? source.size() / kFewPoints : 1;
  for (result.iterations = 1; result.iterations <= config_.max_iterations; ++result.iterations) {
    if (2 * result.iterations > config_.max_iterations) stride = 1;
    sums = linearise(map, source, stride, local, sigma_m, parallel, result);
    Stopwatch watch;
    Vector6d gradient;
    information = balance(sums, gradient);
    // What is reported is what the scan itself has said, without the support.
    Matrix6d total = information;
    if (config_.mode == IcpMode::kRobust) {
      result.min_eigenvalue_ratio = support_weak_directions(sums, lever, total, gradient);
    }
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
    if (config_.mode != IcpMode::kRobust) result.min_eigenvalue_ratio = step.min_eigenvalue_ratio;
    result.unobserved_directions = step.unobserved;
    local = se3_exp(step.x) * local;
    result.ms_solve += watch.lap();
    const double length = step.x.norm();
    if (stride == 1 && length < config_.convergence_m) {
      result.converged = true;
      break;
    }
    // What is searched now is asked again after steps that become shorter and shorter.
    margin_m_ = std::clamp(kMarginSteps * static_cast<float>(length), kLeastMargin, kMostMargin);
    if (length < config_.coarse_step_m) stride = 1;
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
