// Where registration begins when the prediction is not to be trusted: the second scan of a map, after a gap,
// and where predictions have been far off.
#include <algorithm>
#include <limits>

#include "frontend/odometry/track.hpp"

namespace hp2 {
namespace {

// Fewer source points than this share near the map after a gap: the sensor is somewhere else.
constexpr double kLostInliers = 0.7;
constexpr double kBadly = 0.93;   // of the usual fit
constexpr double kBetter = 1.02;  // than another fit
constexpr double kKnownStart_m =
    0.6;                          // sigma of a start whose speed is known to half a metre an interval or so
constexpr double kFarther = 1.5;  // than the usual interval

}  // namespace

// After a gap the prediction may be far off: true if the scan does not lie on the map, neither where it was
// registered from the prediction nor, should the sensor have stood still meanwhile, from the last pose.
bool Track::astray(double sigma, IcpResult& icp) {
  if (!motion_.is_gap(scan_->utime) || icp.inlier_ratio >= kLostInliers) return false;
  const IcpResult still = icp_.align(map_, source_, motion_.last_pose(), sigma, *parallel_);
  if (still.inlier_ratio > icp.inlier_ratio) icp = still;
  if (icp.inlier_ratio >= kLostInliers) return false;
  remarks_->add("tracking was lost: " + std::to_string(motion_.interval_us(scan_->utime) / 1000) +
                " ms without a scan, and then nothing fits the map; a new piece of map begins, which the "
                "back-end joins when a place is seen again");
  return true;
}

// After dropped scans the prediction can be off by more than sigma, which goes by what earlier predictions
// have told: whatever moved the sensor may have begun behind them. Where the scan fits badly it is registered
// with a scale to match, and with sigma again from there.
void Track::look_farther(IcpResult& icp, double sigma, const PosePrior& prior) {
  const double wider = std::min(config_.max_sigma_m, motion_.interval_ratio(scan_->utime) * sigma);
  if (icp_.config().mode != IcpMode::kRobust || wider < kFarther * sigma || icp.fit >= kBadly * usual_fit_)
    return;
  const IcpResult far = icp_.align(map_, source_, prior.map_from_source, wider, *parallel_, &prior);
  const IcpResult other = icp_.align(map_, source_, far.map_from_source, sigma, *parallel_, &prior);
  if (other.fit > kBetter * icp.fit) icp = other;
}

// The prediction is expected to be farther off than ICP reaches, by those before it or for the time that it
// spans, and the scan fits worse than most: ICP is begun at other guesses too, with a part of the points and
// for a few iterations each, the farther ones only while none fits. Where one of them fits better the scan is
// registered from there.
void Track::search_around(IcpResult& icp, double sigma, const PosePrior& prior) {
  constexpr double kTurn = 0.1;  // [rad], from guess to guess about each axis; ICP reaches the angles between
  constexpr int kRings = 3;
  constexpr int kIterations = 20;
  constexpr std::size_t kPoints = 1500;
  if (icp_.config().mode != IcpMode::kRobust || icp.fit >= usual_fit_) return;
  std::vector<Eigen::Vector3f> part;
  const std::size_t stride = (source_.size() + kPoints - 1) / kPoints;
  for (std::size_t i = 0; i < source_.size(); i += stride) part.push_back(source_[i]);
  IcpConfig brief = icp_.config();
  brief.max_iterations = std::min(brief.max_iterations, kIterations);
  HybridIcp scout(brief);
  double best_fit = icp.fit;
  std::optional<Pose> best;
  const Pose base = motion_.usual_step();
  const auto look = [&](const Eigen::Vector3d& turn) {
    const Pose guess(base.rotation * so3_exp(turn), base.translation);
    const IcpResult found = scout.align(map_, part, guess, sigma, *parallel_, &prior);
    if (found.fit <= best_fit) return;
    best_fit = found.fit;
    best = found.map_from_source;
  };
  look(Eigen::Vector3d::Zero());
  for (int ring = 1; ring <= kRings && (ring == 1 || best_fit < kBadly * usual_fit_); ++ring) {
    for (const int axis : {2, 0, 1}) {
      look(ring * kTurn * Eigen::Vector3d::Unit(axis));
      look(-ring * kTurn * Eigen::Vector3d::Unit(axis));
    }
  }
  if (!best) return;
  const IcpResult other = icp_.align(map_, source_, *best, sigma, *parallel_, &prior);
  if (other.fit > kBetter * icp.fit) icp = other;
}

// The present scan is a first one: of a new local map, at a speed that is not known.
void Track::begin_anew() {
  map_ = LocalMap(config_.voxel_size_m, config_.max_points_per_voxel, config_.min_spacing_m);
  scale_ = AdaptiveScale(config_.initial_sigma_m, config_.min_sigma_m, config_.sigma_window);
  moved_ = false;
  usual_fit_ = 1.0;
  motion_.restart();
  first_cloud_ = scan_->cloud;
}

void Track::start_with(const Vector6d& velocity, std::int64_t duration_us, const Parallel& parallel) {
  parallel_ = &parallel;
  const Pose pose = motion_.last_pose();
  motion_.start(velocity);
  scale_ = AdaptiveScale(std::min(kKnownStart_m, config_.initial_sigma_m), config_.min_sigma_m,
                         config_.sigma_window);
  deskewed(first_cloud_, static_cast<double>(duration_us) * velocity, points_);
  map_ = LocalMap(config_.voxel_size_m, config_.max_points_per_voxel, config_.min_spacing_m);
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

void Track::move(const Pose& by) {
  map_.move(by);
  motion_.move(by);
  builder_.move(by);
  evicted_at_ = by * evicted_at_;
}

// The sensor may be at full speed in its first scan, which could not be deskewed, and the second has no
// prediction. Once the second is registered, the speed is known: both are deskewed by it, the map is made
// again, and so on. Point-to-point reaches farther than planes do, so mode robust tries it as well and takes
// what fits clearly better.
IcpResult Track::moving_start(double sigma) {
  constexpr double kBetterStart = 1.01;
  const Pose first = motion_.last_pose();
  IcpResult icp = icp_.align(map_, source_, first, sigma, *parallel_);
  icp = settle_start(icp, sigma, icp_);
  if (icp_.config().mode == IcpMode::kRobust) {
    IcpConfig points = icp_.config();
    points.mode = IcpMode::kPointToPoint;
    HybridIcp point_icp(points);
    IcpResult other = point_icp.align(map_, source_, first, sigma, *parallel_);
    other = settle_start(other, sigma, point_icp);
    other = icp_.align(map_, source_, other.map_from_source, sigma, *parallel_);
    icp = other.fit > kBetterStart * icp.fit ? other : settle_start(icp, sigma, icp_);
  }
  first_cloud_ = PreprocessedScan();
  return icp;
}

// Registers the second scan from `icp` on, deskewing both scans by what comes out.
IcpResult Track::settle_start(IcpResult icp, double sigma, HybridIcp& aligner) {
  constexpr int kRounds = 3;
  const Pose first = motion_.last_pose();
  const double per_sweep = motion_.sweep_share(scan_->duration_us, scan_->utime);
  std::vector<Eigen::Vector3f> first_points;
  for (int round = 0; round < kRounds; ++round) {
    if (!first_cloud_.time.empty()) {
      const Vector6d twist = per_sweep * se3_log(first.inverse() * icp.map_from_source);
      deskewed(first_cloud_, twist, first_points);
      map_ = LocalMap(config_.voxel_size_m, config_.max_points_per_voxel, config_.min_spacing_m);
      map_.insert(first_points, first, first.translation);
      deskew(twist);
    }
    icp = aligner.align(map_, source_, icp.map_from_source, sigma, *parallel_);
    if (first_cloud_.time.empty()) break;
  }
  return icp;
}

}  // namespace hp2
