#include "backend/closure_verifier.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "backend/submap_bend.hpp"
#include "frontend/registration.hpp"
#include "frontend/submap_builder.hpp"

namespace hp2 {
namespace {

// The registration is coarse first (its reach is a voxel), then fine.
constexpr double kCoarseVoxel = 2.0, kCoarseSigma = 1.0;  // [m]
constexpr double kFineSigma = 0.4, kFineDistance = 0.6;   // [m]
constexpr std::size_t kCoarseSource = 2000, kFineSource = 4000;

constexpr double kMaxResidual = 0.25;     // [m], RMS
constexpr int kMinStructure = 150;        // voxels above the ground in common
constexpr double kMinCommonShare = 0.10;  // of the smaller submap's columns
// Share of the surfaces in common that must oppose a move in the least fixed direction.
constexpr double kMinConstraint = 0.015;
constexpr double kNonPlanarWeight = 0.15;  // a bush fixes a position less well than a wall
// A shifted pose that explains this share of what the best one explains makes the place ambiguous.
constexpr double kAmbiguous = 0.85;
constexpr double kShiftFrom = 2.0, kShiftTo = 16.0, kShiftStep = 1.5;  // [m]
constexpr double kShiftAngles = 12;
constexpr std::size_t kShiftSample = 600, kOverlapSample = 6000;
constexpr double kSamePlace =
    0.7;  // [m]: a shifted registration that comes back to within this confirms the pose
constexpr float kSharp = 0.2F;  // [m]: what counts as the same surface where two poses are compared
// What a closure is never better than: the submaps are bent by as much themselves.
constexpr double kTranslationFloor = 0.04;  // [m]
constexpr double kRotationFloor = 0.002;    // [rad]
constexpr double kMaxBend_m = 1.0, kMaxBend_rad = 0.07;
constexpr double kSurfaceNoise = 0.5;  // [m] a voxel: 0.1 m, and neighbours are no independent witnesses

std::vector<Eigen::Vector3f> every_nth(const std::vector<Eigen::Vector3f>& points, std::size_t most) {
  const std::size_t stride = std::max<std::size_t>(1, (points.size() + most - 1) / most);
  std::vector<Eigen::Vector3f> out;
  for (std::size_t i = 0; i < points.size(); i += stride) out.push_back(points[i]);
  return out;
}

int stride_for(const CheckedSubmap& submap, std::size_t sample) {
  return static_cast<int>(1 + submap.cloud.voxels().size() / sample);
}

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

FrontendConfig fine_config() {
  FrontendConfig fine;
  fine.mode = "robust";
  return fine;
}

Pose register_fine(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess) {
  return register_clouds(from.points, every_nth(to.points, kFineSource), guess, fine_config(), kFineSigma,
                         kFineDistance)
      .target_from_source;
}

// Share of the best pose's agreement that another pose within `reach_m` reaches. Most shifted poses explain
// far less and are done with at a glance; one that does not (along a corridor) is registered itself: if it
// slides back to the best pose, there is but one.
double ambiguity(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                 double reach_m) {
  const int stride = stride_for(to, kShiftSample);
  const Overlap here = overlap_of(to.cloud, from.cloud, from_from_to, stride, 0.3F);
  if (here.structure == 0) return 1.0;
  double best = 0.0;
  Pose best_pose = from_from_to;
  const Eigen::Quaterniond up = from.ground.ground_from_submap.rotation.conjugate();
  for (double d = kShiftFrom; d <= std::min(kShiftTo, reach_m); d += kShiftStep) {
    for (int k = 0; k < kShiftAngles; ++k) {
      const double angle = k * 2.0 * M_PI / kShiftAngles;
      Pose shifted = from_from_to;
      shifted.translation += up * Eigen::Vector3d(d * std::cos(angle), d * std::sin(angle), 0.0);
      const Overlap there = overlap_of(to.cloud, from.cloud, shifted, stride, 0.3F);
      // A shift that brings hardly anything together says nothing.
      if (2 * there.structure < here.structure || there.share <= best) continue;
      best = there.share;
      best_pose = shifted;
    }
  }
  const double share = best / std::max(here.share, 1e-9);
  if (share <= kAmbiguous) return share;
  const Pose again = register_fine(from, to, best_pose);
  if ((again.translation - from_from_to.translation).norm() < kSamePlace) return 0.0;
  const int fine_stride = stride_for(to, kOverlapSample);
  const Overlap other = overlap_of(to.cloud, from.cloud, again, fine_stride, kSharp);
  const Overlap first = overlap_of(to.cloud, from.cloud, from_from_to, fine_stride, kSharp);
  return other.share / std::max(first.share, 1e-9);
}

}  // namespace

// Another front-end may send no normals. Stored ones are of unit length to 1/127 only.
namespace {
std::vector<Eigen::Vector3f> normals_of(const Submap& submap) {
  if (submap.normals.size() == submap.points.size()) {
    auto normals = submap.normals;
    for (auto& normal : normals) {
      if (normal.squaredNorm() > 0.0F) normal.normalize();
    }
    return normals;
  }
  Submap copy;
  copy.points = submap.points;
  estimate_normals(copy);
  return copy.normals;
}
}  // namespace

CheckedSubmap::CheckedSubmap(const Submap& submap, const GroundAlignment& ground_alignment)
    : id(submap.id),
      ground(ground_alignment),
      points(submap.points),
      cloud(submap.points, normals_of(submap), ground_alignment.ground_from_submap) {
  // After a loss of tracking the sensor never was at the keypose.
  const bool lost = !submap.scans.empty() && submap.scans.front().state == TrackingState::kLost;
  path.emplace_back(lost ? submap.scans.front().submap_from_sensor.translation : Eigen::Vector3d::Zero());
  for (const ScanPose& s : submap.scans) {
    if ((s.submap_from_sensor.translation - path.back()).norm() > 0.5)
      path.push_back(s.submap_from_sensor.translation);
  }
}

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
                             double guess_rad, const BackendConfig& config) {
  ClosureRecord c;
  c.from_submap = from.id;
  c.to_submap = to.id;
  c.from_from_to = guess;
  const auto refused = [&](const std::string& reason) {
    c.reason = reason;
    return c;
  };

  FrontendConfig coarse;
  coarse.mode = "robust";
  coarse.voxel_size_m = kCoarseVoxel;
  coarse.max_points_per_voxel = 8;
  coarse.min_spacing_m = 0.6;
  const RegistrationResult first = register_clouds(from.points, every_nth(to.points, kCoarseSource), guess,
                                                   coarse, kCoarseSigma, kCoarseSigma);
  FrontendConfig fine;
  fine.mode = "robust";
  const RegistrationResult result =
      register_clouds(from.points, every_nth(to.points, kFineSource), first.target_from_source, fine,
                      kFineSigma, kFineDistance);
  if (!result.target_from_source.is_finite()) return refused("the registration failed");
  c.from_from_to = result.target_from_source;

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
  const double repeated = ambiguity(from, to, c.from_from_to, bound.translation_m);
  if (repeated > kAmbiguous) {
    return refused(
        text("repeated structure: a shifted pose explains %.2f of it, above %.2f", repeated, kAmbiguous));
  }
  const Pose middle({1, 0, 0, 0}, to.path[to.path.size() / 2]);
  const Pose bent = submap_bend(from.points, from.cloud, to.points, c.from_from_to, middle);
  const double bent_m = bent.translation.norm(), bent_rad = rotation_angle(bent.rotation);
  if (!(bent_m < kMaxBend_m) || !(bent_rad < kMaxBend_rad)) {
    return refused(text("the newer submap is bent by %.1f m, %.1f degrees", bent_m, bent_rad * 180.0 / M_PI));
  }
  Vector6d half;
  half << Eigen::Vector3d::Constant(0.5 * bent_m), Eigen::Vector3d::Constant(0.5 * bent_rad);
  const Matrix6d about_middle = half.cwiseAbs2().asDiagonal();
  const Matrix6d move = adjoint(middle);
  c.accepted = true;
  c.information = with_floor(constraint.information, move * about_middle * move.transpose());
  return c;
}

}  // namespace hp2
