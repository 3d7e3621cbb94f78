#include "common/registration/hybrid_icp.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Eigenvalues>

#include "common/registration/stopwatch.hpp"

namespace hp2 {
namespace {

constexpr double kFitScale = 0.5;        // of a voxel: distance at which a point counts half in the fit
constexpr std::size_t kFewPoints = 800;  // enough for the direction of a long step
// A neighbour found by the search stays valid while the point moves by this much [m]: some steps, bounded.
constexpr float kMarginSteps = 5.0F, kLeastMargin = 0.04F, kMostMargin = 0.15F;

// Refinement. Iterations at most; the scales have settled when they are this share of the last ones.
constexpr int kMostRefining = 5;
constexpr double kSameScale = 0.8;
// Directions whose eigenvalue is below this share of the largest are not refined: the residuals that a narrow
// scale rejects may be the only ones that determine them (a highway, a corridor).
constexpr double kRefinedDirections = 0.08;
// The registration before a refinement stops at steps longer by this factor, where no direction is weak.
constexpr double kBeforeRefining = 2.0;

// Factor by which steps are lengthened: 1, 2, 3 while they keep their direction.
class Acceleration {
 public:
  static constexpr int kMostIterations = 15;

  // @param step rotation scaled to metres
  double factor(int iteration, const Vector6d& step) {
    const bool goes_on = iteration >= kFirst && step.dot(last_) > kSame * step.norm() * last_.norm();
    factor_ = goes_on ? std::min(factor_ + 1.0, kMost) : 1.0;
    last_ = step;
    return factor_;
  }

 private:
  // A usual scan has converged before kFirst. Beyond kMost a step would leave the matched surfaces behind.
  static constexpr int kFirst = 6;
  static constexpr double kSame = 0.9, kMost = 3.0;  // kSame: cosine of the angle between them
  Vector6d last_ = Vector6d::Zero();
  double factor_ = 1.0;
};

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

double rms_range_m(const std::vector<Eigen::Vector3f>& source) {
  double squares = 0.0;
  for (const auto& p : source) squares += static_cast<double>(p.squaredNorm());
  return std::sqrt(std::max(1e-6, squares / static_cast<double>(source.size())));
}

// How well the source points fit the map after the last iteration.
void describe_fit(const NormalEquations& sums, std::size_t source_points, IcpResult& result) {
  result.n_planar = sums.planar.count;
  result.n_non_planar = sums.non_planar.count;
  const int count = result.n_planar + result.n_non_planar;
  const double weight = sums.planar.information().topLeftCorner<3, 3>().trace() + sums.non_planar.w;
  result.rms_m = weight > 0.0 ? std::sqrt((sums.planar.squares + sums.non_planar.squares) / weight) : 0.0;
  result.fit = sums.fit / static_cast<double>(source_points);
  result.inlier_ratio = static_cast<double>(count) / static_cast<double>(source_points);
}

}  // namespace

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

// A plane does not constrain motion along itself. Where nearly all correspondences are planar, some direction
// is left to a few points that alpha weighs down: on a bridge, the one along it. Only in such directions the
// in-plane residuals of planar correspondences are added. Elsewhere they would hold the sensor to the pattern
// of its own scan lines.
// @return smallest eigenvalue over the largest, before the addition
double HybridIcp::support_weak_directions(const NormalEquations& sums, double lever, Matrix6d& information,
                                          Vector6d& gradient) {
  const int count = sums.planar.count + sums.non_planar.count;
  if (count == 0) return 0.0;
  Vector6d scale;
  scale << 1.0, 1.0, 1.0, 1.0 / lever, 1.0 / lever, 1.0 / lever;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scale.asDiagonal() * information * scale.asDiagonal());
  const double weak = config_.weak_direction_ratio * eigen.eigenvalues()[5];
  // With a margin of two: the next iteration may find the direction weak again.
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

ResidualScales ResidualScales::narrowed(const NormalEquations& sums) const {
  // Factors on the residuals' RMS, and floors for what noise, deskewing and the map's spacing leave in them.
  constexpr double kPlanar = 1.5, kLeastPlanar = 0.05, kPoint = 1.2, kLeastPoint = 0.1;
  return {std::min(planar_m, std::max(kLeastPlanar, kPlanar * sums.planar.rms_m())),
          std::min(point_m, std::max(kLeastPoint, kPoint * sums.non_planar.rms_m()))};
}

IcpResult HybridIcp::align(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                           double sigma_m, const Parallel& parallel) {
  // Sums are taken about a voxel corner near the sensor, for conditioning and for the precision of floats.
  origin_ = map.locate(guess.translation).voxel;
  correspondences_.assign(source.size(), Correspondence());
  return iterate(map, source, guess, sigma_m, parallel, false);
}

IcpResult HybridIcp::align_again(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                                 double sigma_m, const Parallel& parallel) {
  if (correspondences_.size() != source.size()) return align(map, source, guess, sigma_m, parallel);
  return iterate(map, source, guess, sigma_m, parallel, false);
}

IcpResult HybridIcp::refine(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                            double sigma_m, const Parallel& parallel) {
  if (correspondences_.size() != source.size()) {
    const IcpResult wide = align(map, source, guess, sigma_m, parallel);
    IcpResult narrow = iterate(map, source, wide.map_from_source, sigma_m, parallel, true);
    narrow.add_work(wide);
    return narrow;
  }
  return iterate(map, source, guess, sigma_m, parallel, true);
}

// True if the loss has become clearly narrower, so that the next step is no measure of convergence.
bool HybridIcp::narrow_scales() {
  const ResidualScales before = std::exchange(scales_, scales_.narrowed(sums_));
  return scales_.planar_m < kSameScale * before.planar_m || scales_.point_m < kSameScale * before.point_m;
}

IcpResult HybridIcp::iterate(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                             double sigma_m, const Parallel& parallel, bool refining) {
  IcpResult result;
  refining_ = refining;
  result.map_from_source = guess;
  if (map.empty() || source.empty()) return result;
  const Eigen::Vector3d origin = origin_.cast<double>() * map.voxel_size_m();
  Pose local(guess.rotation, guess.translation - origin);
  fit2_ = static_cast<float>(std::pow(kFitScale * map.voxel_size_m(), 2));
  const double lever = result.mean_range_m = rms_range_m(source);

  Matrix6d information = Matrix6d::Zero();
  in_plane_needed_ = config_.weak_directions;  // unknown before the first iteration
  // Few points are enough for the direction of a long step.
  const bool coarse_first = !refining && config_.coarse_step_m > 0.0 && source.size() > kFewPoints;
  margin_m_ = kMostMargin;
  std::size_t stride = coarse_first ? source.size() / kFewPoints : 1;
  Acceleration acceleration;
  int most = config_.max_iterations;
  if (accelerated_) most = std::min(most, Acceleration::kMostIterations);
  if (refining) most = std::min(most, kMostRefining);
  const double least_ratio =
      refining ? std::max(kRefinedDirections, config_.min_eigenvalue_ratio) : config_.min_eigenvalue_ratio;
  if (!refining) scales_ = {sigma_m, sigma_m};
  for (result.iterations = 1; result.iterations <= most; ++result.iterations) {
    if (2 * result.iterations > most) stride = 1;
    const bool narrowing = refining && narrow_scales();
    sums_ = linearise(map, source, stride, local, sigma_m, parallel, result);
    Stopwatch watch;
    Vector6d gradient;
    information = balance(sums_, gradient);
    // The reported ratio is the scan's own, without the support.
    Matrix6d total = information;
    if (config_.weak_directions) {
      result.min_eigenvalue_ratio = support_weak_directions(sums_, lever, total, gradient);
    }
    Step step = solve(total, gradient, lever, least_ratio);
    if (!config_.weak_directions) result.min_eigenvalue_ratio = step.min_eigenvalue_ratio;
    result.unobserved_directions = step.unobserved;
    // Where a refinement follows in all directions, the rest is left to it.
    const bool to_be_refined =
        config_.refinement && !refining && !accelerated_ && result.min_eigenvalue_ratio >= kRefinedDirections;
    const bool converged = stride == 1 && !narrowing &&
                           step.x.norm() < (to_be_refined ? kBeforeRefining : 1.0) * config_.convergence_m;
    if (accelerated_ && !converged) {
      Vector6d metres = step.x;
      metres.tail<3>() *= lever;
      step.x *= acceleration.factor(result.iterations, metres);
    }
    local = se3_exp(step.x) * local;
    result.ms_solve += watch.lap_ms();
    const double length = step.x.norm();
    if (converged) {
      result.converged = true;
      break;
    }
    // Neighbours found now are used again after steps that become shorter and shorter.
    margin_m_ = std::clamp(kMarginSteps * static_cast<float>(length), kLeastMargin, kMostMargin);
    if (length < config_.coarse_step_m) stride = 1;
  }
  result.iterations = std::min(result.iterations, most);
  describe_fit(sums_, source.size(), result);
  // About the source's origin instead of the local one: x_local = x_source + phi cross t.
  Matrix6d shift = Matrix6d::Identity();
  shift.topRightCorner<3, 3>() = -skew(local.translation);
  result.information = shift.inverse().transpose() * information * shift.inverse();
  result.map_from_source = outcome_ = Pose(local.rotation, local.translation + origin);
  return result;
}

}  // namespace hp2
