#include "frontend/odometry/track.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "common/error.hpp"
#include "common/registration/stopwatch.hpp"
#include "frontend/odometry/deskew.hpp"
#include "frontend/odometry/odometry_covariance.hpp"

namespace hp2 {

Track::Track(const FrontendConfig& config)
    : config_(config),
      robust_(robust_parts(config)),
      sizes_(map_sizes(config, MapSizes().voxel_m)),
      map_(new_map()),
      icp_(icp_config(config)),
      scale_(config.initial_sigma_m, config.min_sigma_m, config.sigma_window),
      builder_(config.submap_voxel_m) {}

LocalMap Track::new_map() const {
  return LocalMap(sizes_.voxel_m, config_.max_points_per_voxel, sizes_.spacing_m,
                  robust_.wide_neighbourhoods);
}

FrontendOutput Track::process(const StampedCloud& scan, const TrackContext& context) {
  Stopwatch total, clock;
  FrontendOutput out;
  OdometryResult& o = out.odometry;
  const std::int64_t skipped =
      last_sequence_ >= 0 ? std::max<std::int64_t>(0, scan.sequence - last_sequence_ - 1) : 0;
  last_sequence_ = scan.sequence;

  const Expectation expected = expect(scan, context.remarks);
  sweep_ = SweepMotion();
  deskew(scan, motion_.sweep_twist(scan.duration_us, scan.utime), context.parallel);
  o.diagnostics.ms[0] = static_cast<float>(scan.preprocess_ms) + clock.lap_ms();

  const IcpResult icp = register_scan(scan, expected, context.parallel);
  Verdict verdict = judge(icp, scan, expected, context);
  clock.lap_ms();
  learn_motion(scan, expected, verdict);
  describe(scan, expected, verdict, o);
  o.n_skipped = skipped;
  ScanPose entry;
  entry.sequence = o.sequence;
  entry.utime = o.utime;
  entry.covariance = o.covariance;
  entry.state = o.state;
  o.submap_id = builder_.id();
  out.finished_submap = extend_maps(scan, expected, verdict, entry, skipped, context);
  o.submap_from_sensor = entry.submap_from_sensor;
  o.diagnostics.ms[4] = clock.lap_ms();
  o.diagnostics.ms[5] = static_cast<float>(scan.preprocess_ms) + total.lap_ms();
  auto& stored = out.finished_submap ? out.finished_submap->scans.back() : builder_.last_scan();
  stored.diagnostics = o.diagnostics;
  return out;
}

Track::Expectation Track::expect(const StampedCloud& scan, Remarks& remarks) const {
  if (motion_.time_is_broken(scan.utime)) {
    remarks.once(4,
                 "time stamps stand still or go back: the motion is then predicted as if scans came evenly");
  }
  Expectation e;
  e.pose = motion_.predict(scan.utime);
  e.stretch = motion_.stretch(scan.utime);
  e.error_m = scale_.sigma_m(e.stretch);
  e.most_m = config_.max_sigma_m;
  // Beyond a part of the range a correspondence means nothing.
  if (robust_.map_scale && !map_.empty() && !at_start())
    e.most_m = std::clamp(config_.max_sigma_share * seen_range_m_, config_.min_sigma_m, e.most_m);
  e.sigma_m = std::min(e.error_m, e.most_m);
  e.after_gap = motion_.is_gap(scan.utime);
  e.after_drops = motion_.interval_ratio(scan.utime) > config_.late_scan_ratio;
  return e;
}

void deskew_points(const PreprocessedScan& cloud, const Vector6d& sweep_twist, const Parallel& parallel,
                   std::vector<Eigen::Vector3f>& out) {
  out = cloud.points;
  if (cloud.time.empty() || !(sweep_twist.norm() > 0.0)) return;
  const Deskew move(sweep_twist);
  parallel.for_blocks(out.size(), 1024, [&](std::size_t, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) out[i] = move(cloud.points[i], cloud.time[i]);
  });
}

void Track::deskew(const StampedCloud& scan, const Vector6d& sweep_twist, const Parallel& parallel) {
  if (!scan.cloud.time.empty()) sweep_ = {sweep_twist, scan.duration_us};
  deskew_points(scan.cloud, sweep_twist, parallel, points_);
  source_.clear();
  for (const std::uint32_t i : scan.cloud.source) source_.push_back(points_[i]);
}

// Empty where there is nothing to register, or no map to register to.
IcpResult Track::register_scan(const StampedCloud& scan, const Expectation& expected,
                               const Parallel& parallel) {
  if (source_.empty() || map_.empty()) return {};
  if (at_start()) return register_second(scan, expected.sigma_m, parallel);
  IcpResult icp = icp_.align(map_, source_, expected.pose, expected.sigma_m, parallel);
  if (robust_.guesses && expected.error_m > expected.most_m)
    icp = try_other_guesses(icp, scan, expected, parallel);
  if (robust_.motion_filter) icp = deskew_again(icp, scan, expected, parallel);
  if (robust_.refinement) {
    const IcpResult wide = icp;
    icp = icp_.refine(map_, source_, wide.map_from_source, expected.sigma_m, parallel);
    icp.add_work(wide);
    icp.min_eigenvalue_ratio = wide.min_eigenvalue_ratio;  // of all points, not only of those that agree best
  }
  return icp;
}

// The registration gives the sensor's motion in the sweep. Where that differs from the prediction, the points
// are deskewed with it and registered again.
IcpResult Track::deskew_again(IcpResult icp, const StampedCloud& scan, const Expectation& expected,
                              const Parallel& parallel) {
  for (int pass = 0; pass < config_.redeskew_passes && !scan.cloud.time.empty(); ++pass) {
    const Pose& pose = icp.map_from_source;
    // After a gap the filter's motion is outdated.
    const Vector6d better =
        expected.after_gap
            ? motion_.sweep_twist(scan.duration_us, pose, scan.utime)
            : motion_.sweep_twist(sweep_, pose, registration_covariance(icp, expected.sigma_m), scan.utime);
    const Vector6d change = better - sweep_.twist;
    if (change.head<3>().norm() + icp.mean_range_m * change.tail<3>().norm() < config_.redeskew_threshold_m)
      break;
    deskew(scan, better, parallel);
    const IcpResult before = icp;
    icp = icp_.align_again(map_, source_, before.map_from_source, expected.sigma_m, parallel);
    icp.add_work(before);
  }
  return icp;
}

Track::Verdict Track::judge(const IcpResult& icp, const StampedCloud& scan, const Expectation& expected,
                            const TrackContext& context) {
  constexpr int kFewest = 10;  // correspondences that a pose can come from
  Verdict v;
  v.pose = expected.pose;
  v.is_second = at_start() && !source_.empty();
  v.is_first = map_.empty() && !source_.empty();
  registration_ = icp;
  turned_.clear();
  if (source_.empty()) {
    context.remarks.once(
        5, "a scan has no usable point (all are out of range or not finite): its pose is the prediction");
    v.state = TrackingState::kLost;
  }
  if (v.is_first) first_cloud_ = scan.cloud;
  if (source_.empty() || v.is_first) return v;
  if (v.is_second) first_cloud_ = PreprocessedScan();
  const bool lost = !v.is_second && is_lost(registration_, scan, expected, context);
  const int matched = registration_.n_planar + registration_.n_non_planar;
  v.covariance = registration_covariance(registration_, expected.sigma_m);
  if (lost) {
    begin_anew(scan);
  } else {
    icp_.turned_points(registration_, turned_);
    constexpr double kMemory = 0.95;
    usual_fit_ = kMemory * usual_fit_ + (1.0 - kMemory) * registration_.fit;
    seen_range_m_ = registration_.mean_range_m;
  }
  if (lost || matched < kFewest) {
    v.state = TrackingState::kLost;
    return v;
  }
  v.registered = true;
  v.pose = registration_.map_from_source;
  const bool weak = registration_.min_eigenvalue_ratio < config_.weak_direction_ratio;
  if (weak && weakest_deviation_m(v.covariance) > config_.degenerate_m) v.state = TrackingState::kDegenerate;
  return v;
}

void Track::learn_motion(const StampedCloud& scan, const Expectation& expected, Verdict& v) {
  if (v.registered) {
    const double error = AdaptiveScale::error_m(expected.pose.inverse() * v.pose, scan.cloud.max_range_m);
    moved_ = moved_ || error > config_.min_sigma_m;  // no error where the pose is the prediction
    if (moved_ && !v.is_second) scale_.add(error, expected.stretch);  // the second had no prediction
  }
  if (robust_.motion_filter && !expected.after_gap) {
    motion_.add_filtered(v.pose, scan.utime, sweep_, v.registered ? &v.covariance : nullptr);
  } else {
    motion_.add(v.pose, scan.utime, sweep_);
  }
  // A step far beyond the motion so far is doubtful, whatever its fit.
  if (v.registered && robust_.motion_filter && motion_.surprise() > config_.incredible_surprise)
    v.state = TrackingState::kDegenerate;
}

void Track::describe(const StampedCloud& scan, const Expectation& expected, const Verdict& v,
                     OdometryResult& o) const {
  o.sequence = scan.sequence;
  o.utime = scan.utime;
  o.n_points = scan.n_points;
  o.n_dropped = scan.cloud.dropped;
  o.state = v.state;
  o.odom_from_sensor = v.pose;
  o.covariance = v.covariance;
  if (v.state == TrackingState::kLost) {
    o.covariance = guess_covariance(motion_.last_step());
  } else if (robust_.covariance_terms) {
    // In the first scans a weakly observed direction may have settled on a wrong speed, which the map
    // confirms.
    if (v.state == TrackingState::kDegenerate && motion_.is_new()) o.covariance *= config_.doubtful_speed;
    o.covariance += deskew_covariance(motion_.unevenness(scan.duration_us));
    o.covariance *= std::max(1.0, motion_.surprise());
  }
  const IcpResult& icp = registration_;
  o.n_planar = icp.n_planar;
  o.n_non_planar = icp.n_non_planar;
  o.diagnostics.sigma = static_cast<float>(expected.sigma_m);
  o.diagnostics.alpha = static_cast<float>(icp.alpha());
  o.diagnostics.min_eigenvalue_ratio = static_cast<float>(icp.min_eigenvalue_ratio);
  o.diagnostics.iterations = icp.iterations;
  o.diagnostics.ms[1] = static_cast<float>(icp.ms_search);
  o.diagnostics.ms[2] = static_cast<float>(icp.ms_planarity);
  o.diagnostics.ms[3] = static_cast<float>(icp.ms_solve);
}

std::optional<Submap> Track::extend_maps(const StampedCloud& scan, const Expectation& expected,
                                         const Verdict& v, ScanPose& entry, std::int64_t skipped,
                                         const TrackContext& context) {
  // Where scans are missing before this one, half of its deskewing is a guess: that stays out of the map.
  static const std::vector<Eigen::Vector3f> kNone;
  const bool guessed =
      robust_.dropped_scans && expected.after_drops && v.registered && !scan.cloud.time.empty();
  if (guessed) turned_.clear();
  const double length = context.hold_submap ? std::numeric_limits<double>::infinity() : submap_length_m();
  const Parallel& parallel = context.parallel;
  map_.find_candidates(guessed ? kNone : points_, v.pose, parallel, v.pose.translation);
  builder_.find_new(source_, v.pose, parallel);
  std::optional<Submap> finished;
  parallel.for_blocks(2, 1, [&](std::size_t block, std::size_t, std::size_t) {
    if (block == 0) {
      map_.insert_candidates();
      for (const auto& [i, normal] : turned_)
        map_.insert_other_side(v.pose * source_[i].cast<double>(), normal, v.pose.translation);
    } else {
      // A scan without points is no reason to cut a submap whose scans may get other poses.
      finished = builder_.add_new(v.pose, entry, skipped, length, !context.hold_submap || at_start());
    }
  });
  // Eviction visits every block, so it waits until the sensor has moved by a few of them.
  constexpr double kEvictionStep = 5.0;
  if ((v.pose.translation - evicted_at_).norm() > kEvictionStep) {
    evicted_at_ = v.pose.translation;
    map_.remove_far(evicted_at_, config_.max_range_m + kEvictionStep);
  }
  return finished;
}

// beta. Where the sensor sees little, places differ sooner: indoors submaps are shorter.
double Track::submap_length_m() const {
  constexpr double kOutdoors = 25.0, kIndoors = 15.0, kIndoorRange = 12.0;
  if (config_.submap_length_m > 0.0) return config_.submap_length_m;
  return seen_range_m_ < kIndoorRange ? kIndoors : kOutdoors;
}

void Track::set_sizes(const MapSizes& sizes) {
  const bool same = sizes.voxel_m == sizes_.voxel_m && sizes.spacing_m == sizes_.spacing_m;
  sizes_ = sizes;
  if (same) return;
  LocalMap map = new_map();
  map_.copy_points(map);
  map_ = std::move(map);
}

void Track::move(const Pose& by) {
  map_.move(by);
  motion_.move(by);
  builder_.move(by);
  evicted_at_ = by * evicted_at_;
}

void Track::save(ByteWriter& out) const {
  out.put(last_sequence_);
  out.put(static_cast<std::uint8_t>(moved_));
  out.put(usual_fit_);
  out.put(seen_range_m_);
  out.put(evicted_at_);
  motion_.save(out);
  scale_.save(out);
  builder_.save(out);
  map_.save(out);
  // Not empty where a submap ended with the scan that tracking was lost at.
  out.put(static_cast<std::uint64_t>(first_cloud_.points.size()));
  out.put(static_cast<std::uint8_t>(!first_cloud_.time.empty()));
  for (const auto& p : first_cloud_.points) out.put(p);
  for (const float t : first_cloud_.time) out.put(t);
}

void Track::load(ByteReader& in) {
  last_sequence_ = in.take<std::int64_t>();
  moved_ = in.take<std::uint8_t>() != 0;
  usual_fit_ = in.take<double>();
  if (!(usual_fit_ >= 0.0 && usual_fit_ <= 1.0)) in.fail("usual fit");
  seen_range_m_ = in.take<double>();
  evicted_at_ = in.take<Eigen::Vector3d>();
  if (!evicted_at_.allFinite()) in.fail("place of the last eviction");
  motion_.load(in);
  if (motion_.last_pose().translation.norm() > LocalMap::kReach * sizes_.voxel_m) in.fail("last pose");
  scale_.load(in);
  builder_.load(in);
  map_.load(in);
  const auto first_points = in.take<std::uint64_t>();
  const bool first_times = in.take<std::uint8_t>() != 0;
  first_cloud_ = PreprocessedScan();
  if (first_points > in.left() / sizeof(Eigen::Vector3f)) in.fail("points of a first scan");
  for (std::uint64_t i = 0; i < first_points; ++i) {
    first_cloud_.points.push_back(in.take<Eigen::Vector3f>());
    if (!first_cloud_.points.back().allFinite()) in.fail("points of a first scan");
  }
  for (std::uint64_t i = 0; first_times && i < first_points; ++i) {
    const auto t = in.take<float>();
    if (!(t >= -0.01F && t <= 1.01F)) in.fail("times of a first scan");
    first_cloud_.time.push_back(t);
  }
}

}  // namespace hp2
