#include "backend/closures/closure_verifier.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "backend/closures/ambiguity.hpp"
#include "backend/closures/submap_bend.hpp"

namespace hp2 {
namespace {

constexpr double kMaxResidual = 0.25;     // [m], RMS
constexpr int kMinStructure = 150;        // voxels above the ground in common
constexpr double kMinCommonShare = 0.10;  // of the smaller submap's columns
// Share of the surfaces in common that must oppose a move in the least fixed direction.
constexpr double kMinConstraint = 0.015;
constexpr double kNonPlanarWeight = 0.15;  // a bush fixes a position less well than a wall
// A shifted pose that explains this share of what the best one explains makes the place ambiguous.
constexpr double kAmbiguous = 0.85;
// What a closure is never better than: the submaps are bent by as much themselves.
constexpr double kTranslationFloor = 0.04;  // [m]
constexpr double kRotationFloor = 0.002;    // [rad]
constexpr double kMaxBend_m = 1.0, kMaxBend_rad = 0.07;
// Where the two have less than this share of a half's points in common, what is true of that end need not be
// true of the submap as a whole, and whether it is bent does not show.
constexpr double kGlimpse = 0.1;
constexpr std::size_t kOverlapSample = 6000;  // voxels
constexpr double kSurfaceNoise = 0.5;  // [m] a voxel: 0.1 m, and neighbours are no independent witnesses

std::string text(const char* format, double a, double b) {
  char buffer[160];
  std::snprintf(buffer, sizeof(buffer), format, a, b);
  return buffer;
}

// Information about the pose from the surfaces that match, right increments in the frame of `to`, and the
// smallest eigenvalue of its translation part as a share of all matches.
struct Constraint {
  Matrix6d information = Matrix6d::Zero();
  double weakest = 0.0;
  double residual_m = 0.0;
};

Constraint constraint_of(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to) {
  Constraint out;
  const Eigen::Matrix3f r = from_from_to.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = from_from_to.translation.cast<float>();
  Eigen::Matrix3d directions = Eigen::Matrix3d::Zero();
  double squares = 0.0;
  int n = 0;
  const int stride = stride_for(to, kOverlapSample);
  for (std::size_t i = 0; i < to.cloud.voxels().size(); i += static_cast<std::size_t>(stride)) {
    const VoxelCloud::Voxel& v = to.cloud.voxels()[i];
    const Eigen::Vector3f p = r * v.point + t;
    if (!(p.cwiseAbs().maxCoeff() < 1e5F)) continue;
    const auto* match = from.cloud.nearest(p, 0.4F);
    if (match == nullptr) continue;
    ++n;
    Eigen::Matrix<double, 3, 6> j;
    j << Eigen::Matrix3d::Identity(), -skew(v.point.cast<double>());
    Eigen::Matrix3d weight = kNonPlanarWeight * Eigen::Matrix3d::Identity();
    if (match->normal.squaredNorm() > 0.5F) {
      const Eigen::Vector3d normal = from_from_to.rotation.conjugate() * match->normal.cast<double>();
      weight = normal * normal.transpose();
      squares += std::pow(static_cast<double>(match->normal.dot(match->point - p)), 2);
    } else {
      squares += kNonPlanarWeight * static_cast<double>((match->point - p).squaredNorm());
    }
    directions += weight;
    out.information += j.transpose() * weight * j;
  }
  if (n == 0) return out;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(directions / n, Eigen::EigenvaluesOnly);
  out.weakest = eigen.eigenvalues()[0];
  out.residual_m = std::sqrt(squares / n);
  out.information *= stride / (kSurfaceNoise * kSurfaceNoise);
  return out;
}

// @param extra what the pose is uncertain by beside that
Matrix6d with_floor(const Matrix6d& information, const Matrix6d& extra) {
  Matrix6d covariance =
      (information + 1e-6 * Matrix6d::Identity()).ldlt().solve(Matrix6d::Identity()) + extra;
  covariance.diagonal().head<3>().array() += kTranslationFloor * kTranslationFloor;
  covariance.diagonal().tail<3>().array() += kRotationFloor * kRotationFloor;
  const Matrix6d floored = covariance.ldlt().solve(Matrix6d::Identity());
  return 0.5 * (floored + floored.transpose());
}

}  // namespace

double path_distance(const std::vector<Eigen::Vector3d>& from_path,
                     const std::vector<Eigen::Vector3d>& to_path, const Pose& from_from_to) {
  double best = 1e18;
  for (const auto& q : to_path) {
    const Eigen::Vector3d p = from_from_to * q;
    for (const auto& r : from_path) best = std::min(best, (p - r).squaredNorm());
  }
  return std::sqrt(best);
}

ClosureRecord verify_closure(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess,
                             const PoseBound& bound, double max_path_distance_m, double guess_m,
                             double guess_rad, bool needed, const BackendConfig& config) {
  ClosureRecord c;
  c.from_submap = from.id;
  c.to_submap = to.id;
  c.from_from_to = guess;
  const auto refused = [&](const std::string& reason) {
    c.reason = reason;
    return c;
  };

  const Pose registered = register_fine(from, to, register_coarse(from, to, guess));
  if (!registered.is_finite()) return refused("the registration failed");
  c.from_from_to = registered;

  const int stride = stride_for(to, kOverlapSample), back_stride = stride_for(from, kOverlapSample);
  Overlap forth = overlap_of(to.cloud, from.cloud, c.from_from_to, stride);
  Overlap back = overlap_of(from.cloud, to.cloud, c.from_from_to.inverse(), back_stride);
  forth.common *= stride;
  forth.structure *= stride;
  back.common *= back_stride;
  back.structure *= back_stride;
  const Constraint constraint = constraint_of(from, to, c.from_from_to);
  c.overlap = std::min(forth.share, back.share);
  c.residual_m = constraint.residual_m;

  const Pose moved = guess.inverse() * c.from_from_to;
  const double moved_m = moved.translation.norm(), moved_rad = rotation_angle(moved.rotation);
  if (moved_m > guess_m || moved_rad > guess_rad) {
    return refused(text("the registration ended %.1f m, %.1f degrees from the guess", moved_m,
                        moved_rad * 180.0 / M_PI));
  }
  const Pose off = bound.from_from_to.inverse() * c.from_from_to;
  const double off_m = off.translation.norm(), off_rad = rotation_angle(off.rotation);
  if (off_m > bound.translation_m) {
    return refused(
        text("%.1f m from where odometry puts it, %.1f m are credible", off_m, bound.translation_m));
  }
  if (off_rad > bound.rotation_rad) {
    return refused(text("%.1f degrees from where odometry puts it, %.1f are credible", off_rad * 180.0 / M_PI,
                        bound.rotation_rad * 180.0 / M_PI));
  }
  const double distance = path_distance(from.path, to.path, c.from_from_to);
  if (distance > max_path_distance_m) {
    return refused(text("the paths come no nearer than %.1f m, %.1f m would be a revisit", distance,
                        max_path_distance_m));
  }
  const auto smaller = static_cast<double>(std::min(from.cloud.column_count(), to.cloud.column_count()));
  const double common_columns = std::min(forth.common, back.common) /
                                std::max(1.0, static_cast<double>(to.cloud.voxels().size())) *
                                static_cast<double>(to.cloud.column_count());
  if (std::min(forth.structure, back.structure) < kMinStructure ||
      common_columns < kMinCommonShare * smaller) {
    return refused(text("too little structure in common: %.0f voxels (%.0f are enough)",
                        std::min(forth.structure, back.structure), kMinStructure));
  }
  if (c.overlap < config.min_overlap)
    return refused(text("overlap %.2f, below %.2f", c.overlap, config.min_overlap));
  if (c.residual_m > kMaxResidual)
    return refused(text("residual %.2f m, above %.2f m", c.residual_m, kMaxResidual));
  if (constraint.weakest < kMinConstraint) {
    return refused(text("one direction is not fixed by what both saw: %.4f, below %.4f", constraint.weakest,
                        kMinConstraint));
  }
  const double repeated = ambiguity(from, to, c.from_from_to, bound);
  if (repeated > kAmbiguous) {
    return refused(
        text("repeated structure: a shifted pose explains %.2f of it, above %.2f", repeated, kAmbiguous));
  }
  // A pose is right for a submap as a whole only if the submap is not bent: neither of the two may be.
  const Pose middle({1, 0, 0, 0}, to.path[to.path.size() / 2]);
  const Pose from_middle({1, 0, 0, 0}, from.path[from.path.size() / 2]);
  const SubmapBend newer = submap_bend(from, to, c.from_from_to, middle);
  const SubmapBend older = submap_bend(to, from, newer.from_from_to.inverse(), from_middle);
  const auto bend_m = [](const SubmapBend& s) { return s.bend.translation.norm(); };
  const auto bend_rad = [](const SubmapBend& s) { return rotation_angle(s.bend.rotation); };
  for (const SubmapBend* s : {&newer, &older}) {
    if (bend_m(*s) < kMaxBend_m && bend_rad(*s) < kMaxBend_rad) continue;
    return refused(text(s == &newer ? "the newer submap is bent by %.1f m, %.1f degrees"
                                    : "the older submap is bent by %.1f m, %.1f degrees",
                        bend_m(*s), bend_rad(*s) * 180.0 / M_PI));
  }
  c.from_from_to = older.from_from_to.inverse();
  double half_m = 0.5 * std::hypot(bend_m(newer), bend_m(older));
  double half_rad = 0.5 * std::hypot(bend_rad(newer), bend_rad(older));
  if (std::max(newer.seen, older.seen) < kGlimpse) {
    const double seen = std::max(newer.seen, older.seen);
    if (!needed) {
      return refused(
          text("only a glimpse of it is in view: %.2f of the points, %.2f would do", seen, kGlimpse));
    }
    // What more it would move the submap by may as well be a bend of it.
    if (!(off_m < kMaxBend_m && off_rad < kMaxBend_rad)) {
      return refused(text("a glimpse of it, %.1f m, %.1f degrees from where odometry puts it", off_m,
                          off_rad * 180.0 / M_PI));
    }
    half_m = std::max(half_m, 0.5 * kMaxBend_m);
    half_rad = std::max(half_rad, 0.5 * kMaxBend_rad);
  }
  Vector6d half;
  half << Eigen::Vector3d::Constant(half_m), Eigen::Vector3d::Constant(half_rad);
  const Matrix6d about_middle = half.cwiseAbs2().asDiagonal();
  const Matrix6d move = adjoint(middle);
  c.accepted = true;
  c.information = with_floor(constraint.information, move * about_middle * move.transpose());
  return c;
}

}  // namespace hp2
