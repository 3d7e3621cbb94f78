#include "frontend/odometry/track.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "common/byte_io.hpp"
#include "common/error.hpp"
#include "common/registration/stopwatch.hpp"
#include "frontend/odometry/deskew.hpp"
#include "frontend/odometry/odometry_covariance.hpp"

namespace hp2 {
namespace {

// Below this ratio of the information's eigenvalues the position along some direction is little more than
// noise, and deskewing by it would feed the noise back.
constexpr double kWellObserved = 0.03;
// Below this one the state says so.
constexpr double kDegenerate = 0.03;
// So much larger is the covariance (a factor) while the start's speed may be a wrong one that fits as well:
// from three Avia bridges.
constexpr double kDoubtfulSpeed = 9.0;
// An interval so much longer than the one before has scans missing in it.
constexpr double kDropped = 1.5;

}  // namespace

void Track::deskew(const Vector6d& sweep_twist) {
  if (!scan_->cloud.time.empty()) sweep_ = {sweep_twist, scan_->duration_us};
  deskewed(scan_->cloud, sweep_twist, points_);
  source_.clear();
  for (const std::uint32_t i : scan_->cloud.source) source_.push_back(points_[i]);
}

void Track::deskewed(const PreprocessedScan& cloud, const Vector6d& sweep_twist,
                     std::vector<Eigen::Vector3f>& out) const {
  out = cloud.points;
  if (cloud.time.empty() || !(sweep_twist.norm() > 0.0)) return;
  const Deskew move(sweep_twist);
  parallel_->for_blocks(out.size(), 1024, [&](std::size_t, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) out[i] = move(cloud.points[i], cloud.time[i]);
  });
}

// Motion in the sweep, by what its registration has told. Not filtered while a start is doubtful: a speed
// that is wrong is told by the jumps that it makes.
Vector6d Track::better_sweep(const IcpResult& icp, double sigma, bool filtered) const {
  const Pose& pose = icp.map_from_source;
  if (filtered) return motion_.sweep_twist(sweep_, pose, registration_covariance(icp, sigma), scan_->utime);
  const Vector6d found = motion_.sweep_twist(scan_->duration_us, pose, scan_->utime);
  Vector6d out = predicted_sweep_ + config_.redeskew_gain * (found - predicted_sweep_);
  if (icp.min_eigenvalue_ratio < kWellObserved) out.head<3>() = sweep_.twist.head<3>();
  return out;
}

// beta. Where the sensor sees little, places differ sooner: indoors submaps are shorter.
double Track::submap_length_m() const {
  constexpr double kOutdoors = 25.0, kIndoors = 15.0, kIndoorRange = 12.0;
  if (config_.submap_length_m > 0.0) return config_.submap_length_m;
  return seen_range_m_ < kIndoorRange ? kIndoors : kOutdoors;
}

FrontendOutput Track::process(const StampedCloud& scan, const Parallel& parallel, Remarks& remarks,
                              bool keep_open) {
  Stopwatch total, clock;
  scan_ = &scan;
  parallel_ = &parallel;
  remarks_ = &remarks;
  last_registration_ = IcpResult();
  agreement_ = 0.0;
  turned_.clear();
  icp_.set_accelerated(keep_open);
  FrontendOutput out;
  OdometryResult& o = out.odometry;
  o.sequence = scan.sequence;
  o.utime = scan.utime;
  o.n_points = scan.n_points;
  o.n_dropped = scan.cloud.dropped;
  o.n_skipped = last_sequence_ >= 0 ? std::max<std::int64_t>(0, scan.sequence - last_sequence_ - 1) : 0;
  last_sequence_ = scan.sequence;

  if (motion_.time_is_broken(o.utime)) {
    remarks.once(4,
                 "time stamps stand still or go back: the motion is then predicted as if scans came evenly");
  }
  const Pose predicted = motion_.predict(o.utime);
  // Not while a start is doubtful: a speed that is wrong is told by the jumps that it makes. Nor after a gap,
  // which the motion before says little of.
  const bool filtered = !keep_open && !motion_.is_gap(o.utime);
  sweep_ = SweepMotion();
  predicted_sweep_ = motion_.sweep_twist(scan.duration_us, scan.utime);
  deskew(predicted_sweep_);
  o.diagnostics.ms[0] = static_cast<float>(scan.preprocess_ms) + clock.lap_ms();

  Pose pose = predicted;
  const double stretch = motion_.stretch(o.utime);
  const bool behind_dropped = motion_.interval_ratio(o.utime) > kDropped;
  const double prediction_error = scale_.sigma_m(stretch);
  const double sigma = std::min(prediction_error, config_.max_sigma_m);
  o.diagnostics.sigma = static_cast<float>(sigma);
  if (source_.empty()) {
    remarks.once(
        5, "a scan has no usable point (all are out of range or not finite): its pose is the prediction");
    o.state = TrackingState::kLost;
  } else if (!map_.empty()) {
    const PosePrior prior = motion_.prior(o.utime);
    const bool second = at_start();
    IcpResult icp =
        second ? moving_start(sigma) : icp_.align(map_, source_, predicted, sigma, parallel, &prior);
    if (!second) {
      look_farther(icp, sigma, prior);
      if (prediction_error > config_.max_sigma_m) search_around(icp, sigma, prior);
    }
    // The registration tells how the sensor really moved in the sweep: where that differs from the
    // prediction, the points are moved accordingly and registered once more.
    for (int pass = 0; !second && pass < config_.redeskew_passes && !scan_->cloud.time.empty(); ++pass) {
      const Vector6d better = better_sweep(icp, sigma, filtered);
      const Vector6d change = better - sweep_.twist;
      if (change.head<3>().norm() + icp.mean_range_m * change.tail<3>().norm() < config_.redeskew_threshold_m)
        break;
      deskew(better);
      const IcpResult before = icp;
      icp = icp_.align_again(map_, source_, before.map_from_source, sigma, parallel, &prior);
      icp.add_work(before);
    }
    if (!second && !keep_open && icp_.config().mode == IcpMode::kRobust) {
      const IcpResult wide = icp;
      icp = icp_.refine(map_, source_, wide.map_from_source, sigma, parallel, &prior);
      icp.add_work(wide);
      icp.min_eigenvalue_ratio = wide.min_eigenvalue_ratio;  // of all that the scan has said
    }
    const bool lost = !second && astray(sigma, icp);
    icp_.turned_points(icp, turned_);
    last_registration_ = icp;
    agreement_ = keep_open ? icp_.agreement(map_, source_, icp.map_from_source, parallel) : 0.0;
    o.covariance = registration_covariance(icp, sigma);
    // At the start a weak direction may have settled on a wrong speed, which the map made with it confirms.
    if (motion_.is_new() && icp.min_eigenvalue_ratio < kDegenerate) o.covariance *= kDoubtfulSpeed;
    if (lost) {
      turned_.clear();
      begin_anew();
    } else {
      pose = icp.map_from_source;
      motion_.learn(prior, pose, icp.information);
      constexpr double kMemory = 0.95;
      usual_fit_ = kMemory * usual_fit_ + (1.0 - kMemory) * icp.fit;
      seen_range_m_ = icp.mean_range_m;
    }
    o.n_planar = icp.n_planar;
    o.n_non_planar = icp.n_non_planar;
    if (icp.min_eigenvalue_ratio < kDegenerate) o.state = TrackingState::kDegenerate;
    if (lost || icp.n_planar + icp.n_non_planar < 10) {
      o.state = TrackingState::kLost;
      pose = predicted;
    }
    o.diagnostics.alpha = static_cast<float>(icp.alpha());
    o.diagnostics.min_eigenvalue_ratio = static_cast<float>(icp.min_eigenvalue_ratio);
    o.diagnostics.iterations = icp.iterations;
    o.diagnostics.ms[1] = static_cast<float>(icp.ms_search);
    o.diagnostics.ms[2] = static_cast<float>(icp.ms_planarity);
    o.diagnostics.ms[3] = static_cast<float>(icp.ms_solve);
    const Pose deviation = predicted.inverse() * pose;
    const double error = AdaptiveScale::error_m(deviation, scan_->cloud.max_range_m);
    moved_ = moved_ || error > config_.min_sigma_m;  // no error where the pose is the prediction
    if (moved_ && !second && !lost)
      scale_.add(error, stretch);  // the second scan had no prediction that could err
  } else {
    first_cloud_ = scan.cloud;
  }
  clock.lap_ms();
  const Pose before = motion_.last_pose();
  const bool registered =
      o.state != TrackingState::kLost && last_registration_.n_planar + last_registration_.n_non_planar > 0;
  if (filtered) {
    motion_.add_filtered(pose, o.utime, sweep_, registered ? &o.covariance : nullptr);
  } else {
    motion_.add(pose, o.utime, sweep_);
  }
  if (o.state == TrackingState::kLost) {
    o.covariance = guess_covariance(before.inverse() * predicted);
  } else {
    // Also where scans come without times: somebody has deskewed them with a motion of his own, or nobody
    // has.
    o.covariance += deskew_covariance(motion_.unevenness(scan.duration_us));
    o.covariance *= std::max(1.0, motion_.surprise());
  }
  o.odom_from_sensor = pose;
  o.submap_id = builder_.id();
  ScanPose entry;
  entry.sequence = o.sequence;
  entry.utime = o.utime;
  entry.covariance = o.covariance;
  entry.state = o.state;
  entry.diagnostics = o.diagnostics;
  const double submap_length = keep_open ? std::numeric_limits<double>::infinity() : submap_length_m();
  // Behind dropped scans the motion within the sweep, and with it where deskewing puts the points, is half a
  // guess: that does not enter the map.
  static const std::vector<Eigen::Vector3f> kNone;
  const bool guessed = behind_dropped && registered && !keep_open && !scan.cloud.time.empty() &&
                       icp_.config().mode == IcpMode::kRobust;
  if (guessed) turned_.clear();
  map_.find_candidates(guessed ? kNone : points_, pose, parallel, pose.translation);
  builder_.find_new(source_, pose, parallel);
  parallel.for_blocks(2, 1, [&](std::size_t block, std::size_t, std::size_t) {
    if (block == 0) {
      map_.insert_candidates();
      for (const auto& [i, normal] : turned_) {
        map_.insert_other_side(pose * source_[i].cast<double>(), normal, pose.translation);
      }
    } else {
      // A scan without points is no reason to settle the start that is being searched.
      out.finished_submap =
          builder_.add_new(pose, entry, o.n_skipped, submap_length, !keep_open || at_start());
    }
  });
  // Eviction visits every block, so it waits until the sensor has moved by a few of them.
  constexpr double kEvictionStep = 5.0;
  if ((pose.translation - evicted_at_).norm() > kEvictionStep) {
    evicted_at_ = pose.translation;
    map_.remove_far(evicted_at_, config_.max_range_m + kEvictionStep);
  }

  o.submap_from_sensor = entry.submap_from_sensor;
  o.diagnostics.ms[4] = clock.lap_ms();
  o.diagnostics.ms[5] = static_cast<float>(scan.preprocess_ms) + total.lap_ms();
  auto& stored = out.finished_submap ? out.finished_submap->scans.back() : builder_.last_scan();
  stored.diagnostics = o.diagnostics;
  return out;
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
  if (motion_.last_pose().translation.norm() > LocalMap::kReach * config_.voxel_size_m) in.fail("last pose");
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
