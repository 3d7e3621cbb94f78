// Scan poses have the noise of the registrations; a sensor on a vehicle, or in a hand, has inertia. Every
// scan's pose is moved to the most likely one given both. The amounts of noise and jerk are estimated from
// the drive itself.
#pragma once
#include <cstdint>
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// A smooth curve through noisy samples: the most likely motion with white jerk, evaluated at
/// each of them.
struct SmoothCurve {
  std::vector<std::vector<double>> values;  ///< [component][sample], as the samples.
  double noise = 0.0;                       ///< Standard deviation of the samples' own noise.
  double log10_ratio = 0.0;                 ///< log10 of jerk to noise: q dt^5 / noise^2, dt the median step.
};

/// Smooths samples whose components have the same noise and the same jerk. Both are found by maximum
/// likelihood; samples too few to estimate the noise are returned unchanged.
/// @param samples [component][sample]
/// @param steps   time [any unit] from sample i to i + 1, all above 0
SmoothCurve smooth_curve(const std::vector<std::vector<double>>& samples, const std::vector<double>& steps);

/// Smooths the final poses of a session's scans: the horizontal position, the height and the attitude, each
/// with noise and jerk of its own, which are estimated for every few hundred scans. No pose is smoothed
/// across a loss of tracking.
/// @param submaps    all of the session, in order; their scans' states and times are looked at
/// @param trajectory their scans' final poses, in the same order
void smooth_trajectory(const std::vector<Submap>& submaps, std::vector<TrajectoryPose>& trajectory);

}  // namespace hp2
