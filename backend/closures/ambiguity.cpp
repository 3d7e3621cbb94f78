#include "backend/closures/ambiguity.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace hp2 {
namespace {

constexpr double kSuspicious = 0.85;  // of the best pose's agreement: then the shifted pose is registered
constexpr double kShiftFrom = 2.0, kShiftTo = 16.0, kShiftStep = 1.5;  // [m]
constexpr int kShiftAngles = 12;
constexpr std::size_t kGlanceSample = 600, kSample = 6000;  // voxels
constexpr float kGlanceDistance = 0.3F;  // [m]: distance of the same surface in the coarse comparison
constexpr double kSamePlace =
    0.7;                        // [m]: a shifted registration that returns to within this confirms the pose
constexpr float kSharp = 0.2F;  // [m]: distance of the same surface where two poses are compared
// An alternative pose that odometry contradicts must agree better by this to count.
constexpr double kOdometrySays = 0.1;
constexpr double kNoBound = 1e8;  // [m]

// Likelihood of `other` relative to `pose` given the graph, whose bound is taken as three standard
// deviations. 1 where the graph gives no bound.
double credibility(const Pose& other, const Pose& pose, const PoseBound& bound) {
  if (bound.translation_m >= kNoBound) return 1.0;
  const double sigma = bound.translation_m / 3.0;
  const double there = (other.translation - bound.from_from_to.translation).norm() / sigma;
  const double here = (pose.translation - bound.from_from_to.translation).norm() / sigma;
  return std::exp(0.5 * (here * here - there * there));
}

// Structure where the other submap has looked, and how much of it the other one has, too.
struct Glance {
  int structure = 0, same = 0;
  double share() const { return structure > 0 ? static_cast<double>(same) / structure : 0.0; }
};

// Every stride-th voxel of the cloud, if it is structure, rotated into the other one's frame.
std::vector<Eigen::Vector3f> turned_structure(const VoxelCloud& cloud, const Eigen::Quaterniond& turn,
                                              int stride) {
  const Eigen::Matrix3f r = turn.toRotationMatrix().cast<float>();
  std::vector<Eigen::Vector3f> points;
  for (std::size_t i = 0; i < cloud.voxels().size(); i += static_cast<std::size_t>(stride)) {
    if (cloud.voxels()[i].structure) points.emplace_back(r * cloud.voxels()[i].point);
  }
  return points;
}

// Empty where the share cannot exceed `enough`.
Glance glance(const std::vector<Eigen::Vector3f>& structure, const Eigen::Vector3d& translation,
              const VoxelCloud& other, double enough) {
  const Eigen::Vector3f t = translation.cast<float>();
  Glance g;
  for (std::size_t i = 0; i < structure.size(); ++i) {
    const auto left = static_cast<double>(structure.size() - i);
    if (g.same + left <= enough * (g.structure + left)) return {};
    const Eigen::Vector3f p = structure[i] + t;
    if (!(p.cwiseAbs().maxCoeff() < 1e5F) || !other.seen(p)) continue;
    ++g.structure;
    g.same += other.any_near(p, kGlanceDistance);
  }
  return g;
}

}  // namespace

double ambiguity(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                 const PoseBound& bound) {
  const std::vector<Eigen::Vector3f> structure =
      turned_structure(to.cloud, from_from_to.rotation, stride_for(to, kGlanceSample));
  const Glance here = glance(structure, from_from_to.translation, from.cloud, -1.0);
  if (here.structure == 0) return 1.0;
  double best = 0.0;
  Pose best_pose = from_from_to;
  const Eigen::Quaterniond up = from.ground.ground_from_submap.rotation.conjugate();
  for (double d = kShiftFrom; d <= std::min(kShiftTo, bound.translation_m); d += kShiftStep) {
    for (int k = 0; k < kShiftAngles; ++k) {
      const double angle = k * 2.0 * M_PI / kShiftAngles;
      Pose shifted = from_from_to;
      shifted.translation += up * Eigen::Vector3d(d * std::cos(angle), d * std::sin(angle), 0.0);
      const Glance there = glance(structure, shifted.translation, from.cloud, best);
      // With little structure in common a shift gives no evidence.
      if (2 * there.structure < here.structure || there.share() <= best) continue;
      best = there.share();
      best_pose = shifted;
    }
  }
  const double share = best / std::max(here.share(), 1e-9);
  if (share <= kSuspicious) return share;
  const Pose again = register_fine(from, to, best_pose);
  if ((again.translation - from_from_to.translation).norm() < kSamePlace) return 0.0;
  const int fine_stride = stride_for(to, kSample);
  const Overlap other = overlap_of(to.cloud, from.cloud, again, fine_stride, kSharp);
  const Overlap first = overlap_of(to.cloud, from.cloud, from_from_to, fine_stride, kSharp);
  const double explained = other.share / std::max(first.share, 1e-9);
  // Odometry lowers this by a tenth at most: a structure may repeat exactly.
  return explained - kOdometrySays * (1.0 - std::min(1.0, credibility(again, from_from_to, bound)));
}

}  // namespace hp2
