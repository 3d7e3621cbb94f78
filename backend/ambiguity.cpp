#include "backend/ambiguity.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {
namespace {

constexpr double kSuspicious = 0.85;  // of what the best pose explains: then the shifted pose is registered
constexpr double kShiftFrom = 2.0, kShiftTo = 16.0, kShiftStep = 1.5;  // [m]
constexpr int kShiftAngles = 12;
constexpr std::size_t kGlanceSample = 600, kSample = 6000;  // voxels
constexpr double kSamePlace =
    0.7;  // [m]: a shifted registration that comes back to within this confirms the pose
constexpr float kSharp = 0.2F;  // [m]: what counts as the same surface where two poses are compared
// A pose that odometry speaks against must explain so much more to be a rival.
constexpr double kOdometrySays = 0.1;
constexpr double kNoBound = 1e8;  // [m]

// How much less credible than at `pose` the sensor is at `other`, given the graph: its bound is taken for
// three standard deviations. 1 where the graph says nothing.
double credibility(const Pose& other, const Pose& pose, const PoseBound& bound) {
  if (bound.translation_m >= kNoBound) return 1.0;
  const double sigma = bound.translation_m / 3.0;
  const double there = (other.translation - bound.from_from_to.translation).norm() / sigma;
  const double here = (pose.translation - bound.from_from_to.translation).norm() / sigma;
  return std::exp(0.5 * (here * here - there * there));
}

}  // namespace

double ambiguity(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                 const PoseBound& bound) {
  const int stride = stride_for(to, kGlanceSample);
  const Overlap here = overlap_of(to.cloud, from.cloud, from_from_to, stride, 0.3F);
  if (here.structure == 0) return 1.0;
  double best = 0.0;
  Pose best_pose = from_from_to;
  const Eigen::Quaterniond up = from.ground.ground_from_submap.rotation.conjugate();
  for (double d = kShiftFrom; d <= std::min(kShiftTo, bound.translation_m); d += kShiftStep) {
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
  if (share <= kSuspicious) return share;
  const Pose again = register_fine(from, to, best_pose);
  if ((again.translation - from_from_to.translation).norm() < kSamePlace) return 0.0;
  const int fine_stride = stride_for(to, kSample);
  const Overlap other = overlap_of(to.cloud, from.cloud, again, fine_stride, kSharp);
  const Overlap first = overlap_of(to.cloud, from.cloud, from_from_to, fine_stride, kSharp);
  const double explained = other.share / std::max(first.share, 1e-9);
  // What explains as much is no less likely for where odometry has it: a structure repeats itself for good.
  return explained - kOdometrySays * (1.0 - std::min(1.0, credibility(again, from_from_to, bound)));
}

}  // namespace hp2
