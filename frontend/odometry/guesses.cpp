// Where registration begins when the prediction cannot be trusted: the second scan of a map, after a gap, and
// where predictions have been far off.
#include <algorithm>
#include <cmath>
#include <limits>

#include "frontend/odometry/track.hpp"

namespace hp2 {

// Where the prediction is expected to be farther off than ICP reaches, and the scan fits worse than most, ICP
// begins at other guesses too, with a part of the points and for a few iterations each. The farther guesses
// come only while none fits. A fit counts less the less credible the motion to it is.
IcpResult Track::try_other_guesses(const IcpResult& icp, const StampedCloud& scan,
                                   const Expectation& expected, const Parallel& parallel) {
  const GuessConfig& g = config_.guesses;
  if (icp.fit >= usual_fit_) return icp;
  std::vector<Eigen::Vector3f> part;
  const std::size_t stride = (source_.size() + g.points - 1) / g.points;
  for (std::size_t i = 0; i < source_.size(); i += stride) part.push_back(source_[i]);
  IcpConfig brief = icp_.config();
  brief.max_iterations = std::min(brief.max_iterations, g.iterations);
  HybridIcp scout(brief);
  const auto score = [&](const IcpResult& r) {
    const double doubt = motion_.surprise_at(r.map_from_source, scan.utime, scan.duration_us);
    return r.fit - g.doubt_weight * std::log(1.0 + doubt);
  };
  const double own = score(icp);
  double best_score = own, best_fit = icp.fit;
  std::optional<Pose> best;
  const Pose base = motion_.usual_step();
  const auto look = [&](const Eigen::Vector3d& turn) {
    const Pose guess(base.rotation * so3_exp(turn), base.translation);
    const IcpResult found = scout.align(map_, part, guess, expected.sigma_m, parallel);
    if (score(found) <= best_score) return;
    best_score = score(found);
    best_fit = found.fit;
    best = found.map_from_source;
  };
  look(Eigen::Vector3d::Zero());
  for (int ring = 1; ring <= g.rings && (ring == 1 || best_fit < g.bad_fit * usual_fit_); ++ring) {
    for (const int axis : {2, 0, 1}) {
      look(ring * g.turn_rad * Eigen::Vector3d::Unit(axis));
      look(-ring * g.turn_rad * Eigen::Vector3d::Unit(axis));
    }
  }
  if (!best) return icp;
  const IcpResult other = icp_.align(map_, source_, *best, expected.sigma_m, parallel);
  if (score(other) > own + (g.better_fit - 1.0) * icp.fit) return other;
  // What was found for the points is that of `other`: registered once more from where it was.
  return icp_.align(map_, source_, icp.map_from_source, expected.sigma_m, parallel);
}

// After a gap the prediction may be far off: true if the scan does not lie on the map, neither where it was
// registered from the prediction nor, should the sensor have stood still meanwhile, from the last pose.
bool Track::is_lost(IcpResult& icp, const StampedCloud& scan, const Expectation& expected,
                    const TrackContext& context) {
  const double least = config_.guesses.lost_inliers;
  if (!expected.after_gap || icp.inlier_ratio >= least) return false;
  const IcpResult still = icp_.align(map_, source_, motion_.last_pose(), expected.sigma_m, context.parallel);
  if (still.inlier_ratio > icp.inlier_ratio) icp = still;
  if (icp.inlier_ratio >= least) return false;
  context.remarks.add(
      "tracking was lost: " + std::to_string(motion_.interval_us(scan.utime) / 1000) +
      " ms without a scan, and then nothing fits the map; a new piece of map begins, which the "
      "back-end joins when a place is seen again");
  return true;
}

// The present scan is a first one: of a new local map, at a speed that is not known.
void Track::begin_anew(const StampedCloud& scan) {
  map_ = new_map();
  scale_ = AdaptiveScale(config_.initial_sigma_m, config_.min_sigma_m, config_.sigma_window);
  moved_ = false;
  usual_fit_ = 1.0;
  motion_.restart();
  first_cloud_ = scan.cloud;
}

void Track::start_with(const Vector6d& velocity, std::int64_t duration_us, const Parallel& parallel) {
  const Pose pose = motion_.last_pose();
  motion_.start(velocity);
  scale_ = AdaptiveScale(std::min(config_.guesses.known_speed_sigma_m, config_.initial_sigma_m),
                         config_.min_sigma_m, config_.sigma_window);
  deskew_points(first_cloud_, static_cast<double>(duration_us) * velocity, parallel, points_);
  map_ = new_map();
  map_.insert(points_, pose, pose.translation);
  if (begins_session()) {
    source_.clear();
    for (const std::uint32_t i : first_cloud_.source) source_.push_back(points_[i]);
    ScanPose first = builder_.open_scans().front();
    builder_ = SubmapBuilder(config_.submap_voxel_m);
    builder_.add(source_, pose, first, 0, std::numeric_limits<double>::infinity());
  }
  first_cloud_ = PreprocessedScan();
}

// The sensor may be at full speed in its first scan, which could not be deskewed, and the second has no
// prediction. Once the second is registered, the speed is known: both are deskewed by it, the map is made
// again, and so on.
IcpResult Track::register_second(const StampedCloud& scan, double sigma_m, const Parallel& parallel) {
  constexpr int kRounds = 3;
  const Pose first = motion_.last_pose();
  const double per_sweep = motion_.sweep_share(scan.duration_us, scan.utime);
  IcpResult icp = icp_.align(map_, source_, first, sigma_m, parallel);
  std::vector<Eigen::Vector3f> first_points;
  for (int round = 0; robust_.motion_filter && round < kRounds; ++round) {
    if (!first_cloud_.time.empty()) {
      const Vector6d twist = per_sweep * se3_log(first.inverse() * icp.map_from_source);
      deskew_points(first_cloud_, twist, parallel, first_points);
      map_ = new_map();
      map_.insert(first_points, first, first.translation);
      deskew(scan, twist, parallel);
    }
    icp = icp_.align(map_, source_, icp.map_from_source, sigma_m, parallel);
    if (first_cloud_.time.empty()) break;
  }
  return icp;
}

}  // namespace hp2
