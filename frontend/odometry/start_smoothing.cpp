#include "frontend/odometry/start_smoothing.hpp"

#include <algorithm>
#include <cstdint>

namespace hp2 {
namespace {

constexpr std::size_t kFewest = 8;  // scans
// Farther than this no start begins from where it was thought to [m, rad].
constexpr double kMost = 5.0, kMostTurn = 0.5;
constexpr double kApart = 0.5;  // [m], RMS of the two ways' distance: more, and one of them is wrong

// As if time ran backwards: the sweep begins where it has ended.
StampedCloud reversed(const StampedCloud& scan, std::int64_t mirror_utime) {
  StampedCloud out = scan;
  for (float& t : out.cloud.time) t = 1.0F - t;
  out.utime = mirror_utime - (scan.utime - scan.duration_us);
  return out;
}

double interval(const StampedCloud& from, const StampedCloud& to) {
  return static_cast<double>(to.utime - from.utime);
}

// Mean velocity over the last intervals [twist / us].
Vector6d last_velocity(const std::vector<StampedCloud>& scans, const std::vector<Pose>& poses) {
  constexpr std::size_t kIntervals = 4;
  Vector6d sum = Vector6d::Zero();
  for (std::size_t i = poses.size() - kIntervals; i < poses.size(); ++i) {
    sum += se3_log(poses[i - 1].inverse() * poses[i]) / interval(scans[i - 1], scans[i]);
  }
  return sum / static_cast<double>(kIntervals);
}

// The way back in a frame of its own; empty if it is lost.
std::vector<Pose> way_back(const FrontendConfig& config, const std::vector<StampedCloud>& scans,
                           const Vector6d& velocity, const Parallel& parallel) {
  const std::size_t n = scans.size();
  const std::int64_t mirror = 2 * scans.back().utime;
  Track track(config);
  Remarks ignored;  // the track that was followed has made them
  track.process(reversed(scans.back(), mirror), parallel, ignored, false);
  track.start_with(-velocity, scans.back().duration_us, parallel);
  std::vector<Pose> out(n);
  out[n - 1] = track.last_pose();
  for (std::size_t i = n - 1; i-- > 0;) {
    const StampedCloud scan = reversed(scans[i], mirror);
    if (track.process(scan, parallel, ignored, false).odometry.state == TrackingState::kLost) return {};
    out[i] = track.last_pose();
  }
  // These are where the sweeps begin.
  const std::vector<Pose> begins = out;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t a = std::min(i, n - 2);
    const double share = static_cast<double>(scans[i].duration_us) / interval(scans[a], scans[a + 1]);
    out[i] = begins[i] * se3_exp(share * se3_log(begins[a].inverse() * begins[a + 1]));
  }
  return out;
}

}  // namespace

std::vector<Pose> smoothed_start(const FrontendConfig& config, const std::vector<StampedCloud>& scans,
                                 const std::vector<Pose>& poses, const Parallel& parallel) {
  const std::size_t n = scans.size();
  if (n < kFewest || poses.size() != n) return {};
  for (std::size_t i = 0; i < n; ++i) {
    if (scans[i].cloud.time.empty() || (i > 0 && !(interval(scans[i - 1], scans[i]) > 0.0))) return {};
  }
  const std::vector<Pose> back = way_back(config, scans, last_velocity(scans, poses), parallel);
  if (back.empty()) return {};
  // The two ways are laid on each other where both have been under way for a while.
  const std::size_t first = n / 4, end = n - n / 4, middle = n / 2;
  const auto count = static_cast<double>(end - first);
  std::vector<Vector6d> apart;
  Vector6d mean = Vector6d::Zero();
  for (std::size_t i = first; i < end; ++i) {
    const Pose way = poses[middle].inverse() * poses[i], other = back[middle].inverse() * back[i];
    apart.push_back(se3_log(way * other.inverse()));
    mean += apart.back() / count;
  }
  double squares = 0.0;
  for (const Vector6d& a : apart) squares += (a - mean).head<3>().squaredNorm();
  if (!(squares / count < kApart * kApart)) return {};
  const Pose odom_from_back = poses[middle] * se3_exp(mean) * back[middle].inverse();
  std::vector<Pose> out;
  for (std::size_t i = 0; i < n; ++i) {
    const double weight = static_cast<double>(n - 1 - i) / static_cast<double>(n - 1);
    const Vector6d move = se3_log(poses[i].inverse() * odom_from_back * back[i]);
    if (!(move.head<3>().norm() < kMost && move.tail<3>().norm() < kMostTurn)) return {};
    out.push_back(poses[i] * se3_exp(weight * move));
  }
  out.back() = poses.back();  // to the last bit
  return out;
}

}  // namespace hp2
