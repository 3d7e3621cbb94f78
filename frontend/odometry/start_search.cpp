#include "frontend/odometry/start_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Eigenvalues>

#include "frontend/odometry/deskew.hpp"

namespace hp2 {
namespace {

constexpr int kMapPoints = 5;  // per voxel of a candidate's map

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double median_interval(const std::vector<ThinScan>& scans) {
  std::vector<double> intervals;
  for (std::size_t i = 1; i < scans.size(); ++i)
    intervals.push_back(static_cast<double>(scans[i].utime - scans[i - 1].utime));
  return median(intervals);
}

// Points [begin, end) of a scan moved to the sweep's end.
std::vector<Eigen::Vector3f> deskewed(const ThinScan& scan, const Vector6d& velocity, std::size_t begin,
                                      std::size_t end) {
  std::vector<Eigen::Vector3f> out(scan.points.begin() + static_cast<std::ptrdiff_t>(begin),
                                   scan.points.begin() + static_cast<std::ptrdiff_t>(end));
  if (scan.time.empty()) return out;
  const Deskew move(static_cast<double>(scan.duration_us) * velocity);
  for (std::size_t i = begin; i < end; ++i) out[i - begin] = move(scan.points[i], scan.time[i]);
  return out;
}

// Scans may be missing, and stamps be off by a part of an interval.
bool is_even(double intervals) {
  constexpr double kMostIntervals = 4.0, kJitter = 0.3;
  const double whole = std::round(intervals);
  return whole >= 1.0 && whole <= kMostIntervals && std::abs(intervals - whole) <= kJitter;
}

// At most one stamp in so many may be out of line: otherwise smoothness cannot be judged.
constexpr std::size_t kMostUneven = 4;

// The scans with stamps out of line moved into it.
void mend_stamps(std::vector<ThinScan>& scans, double usual) {
  std::int64_t before = scans.front().utime, shift = 0;
  for (std::size_t i = 1; i < scans.size(); ++i) {
    const auto interval = static_cast<double>(scans[i].utime - before);
    before = scans[i].utime;
    if (!is_even(interval / usual)) {
      const double whole = std::clamp(std::round(interval / usual), 1.0, 2.0);
      shift += static_cast<std::int64_t>(whole * usual - interval);
    }
    scans[i].utime += shift;
  }
}

std::vector<Eigen::Vector3f> source_of(const ThinScan& scan, const Vector6d& velocity) {
  return deskewed(scan, velocity, 0, scan.n_source);
}

std::vector<Eigen::Vector3f> map_points_of(const ThinScan& scan, const Vector6d& velocity) {
  return deskewed(scan, velocity, scan.n_source, scan.points.size());
}

IcpConfig quick(IcpConfig icp, int iterations) {
  icp.max_iterations = std::min(icp.max_iterations, iterations);
  icp.refinement = false;
  return icp;
}

}  // namespace

ThinScan thinned(const std::vector<Eigen::Vector3f>& points, const std::vector<float>& time,
                 const std::vector<std::uint32_t>& chosen, std::size_t count, std::size_t map_count) {
  ThinScan out;
  const auto take = [&](std::size_t i) {
    out.points.push_back(points[i]);
    if (!time.empty()) out.time.push_back(time[i]);
  };
  const std::size_t stride = std::max<std::size_t>(1, chosen.size() / std::max<std::size_t>(1, count));
  for (std::size_t k = 0; k < chosen.size(); k += stride) take(chosen[k]);
  out.n_source = out.points.size();
  const std::size_t map_stride =
      std::max<std::size_t>(1, points.size() / std::max<std::size_t>(1, map_count));
  for (std::size_t i = 0; i < points.size(); i += map_stride) take(i);
  return out;
}

StartSearch::StartSearch(const StartSearchConfig& config, const IcpConfig& icp, double voxel_m,
                         double spacing_m, std::vector<ThinScan> scans, std::vector<Pose> followed,
                         const Matrix6d& information)
    : config_(config),
      icp_(quick(icp, config.iterations)),
      voxel_m_(voxel_m),
      spacing_m_(spacing_m),
      scans_(std::move(scans)),
      followed_(std::move(followed)) {
  icp_.set_accelerated(true);
  usual_interval_ = median_interval(scans_);
  mend_stamps(scans_, usual_interval_);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(information.topLeftCorner<3, 3>());
  direction_ = followed_.front().rotation.conjugate() * eigen.eigenvectors().col(0);
  for (int k = -config_.steps_aside; k <= config_.steps_aside; ++k) {
    Vector6d velocity = Vector6d::Zero();
    velocity.head<3>() = k * config_.spacing_m / usual_interval_ * direction_;
    add_candidate(velocity);
  }
}

bool StartSearch::worthwhile(const StartSearchConfig& config, const std::vector<ThinScan>& scans,
                             std::vector<double> eigenvalue_ratios) {
  if (scans.size() < config.scans || 2 * eigenvalue_ratios.size() < config.scans) return false;
  const double usual = median_interval(scans);
  if (!(usual > 0.0)) return false;
  std::size_t uneven = 0;
  for (std::size_t i = 1; i < scans.size(); ++i) {
    if (!is_even(static_cast<double>(scans[i].utime - scans[i - 1].utime) / usual)) ++uneven;
  }
  if (kMostUneven * uneven > scans.size()) return false;
  return median(std::move(eigenvalue_ratios)) < config.doubtful_ratio;
}

bool StartSearch::work(int steps, const Parallel& parallel) {
  for (; steps > 0 && round_ != Round::kDone; --steps) {
    const std::size_t until = round_ == Round::kScreening ? config_.screening : scans_.size();
    while (at_ < candidates_.size() && (candidates_[at_].lost || candidates_[at_].poses.size() >= until))
      ++at_;
    if (at_ < candidates_.size()) {
      register_next(candidates_[at_], parallel);
    } else {
      next_round();
    }
  }
  return round_ == Round::kDone;
}

void StartSearch::register_next(Candidate& c, const Parallel& parallel) {
  constexpr double kMinSigma = 0.1;
  constexpr int kWindow = 100;
  constexpr std::size_t kFewest = 10;
  const ThinScan& scan = scans_[c.poses.size()];
  if (c.poses.empty()) {
    c.map.emplace(voxel_m_, kMapPoints, spacing_m_, true);
    c.scale.emplace(config_.sigma_m, kMinSigma, kWindow);
    c.poses.push_back(followed_.front());
    c.last_velocity = c.velocity;
    c.map->insert(map_points_of(scan, c.velocity), c.poses.back(), c.poses.back().translation);
    return;
  }
  const Pose last = c.poses.back();
  const double dt = interval_us(c.poses.size());
  const Pose predicted = last * se3_exp(dt * c.last_velocity);
  if (scan.n_source < kFewest) {  // a covered sensor
    c.poses.push_back(predicted);
    return;
  }
  std::vector<Eigen::Vector3f> source = source_of(scan, c.last_velocity);
  const double sigma = c.scale->sigma_m(1.0);
  IcpResult icp = icp_.align(*c.map, source, predicted, sigma, parallel);
  c.last_velocity = se3_log(last.inverse() * icp.map_from_source) / dt;
  if (!scan.time.empty()) {
    source = source_of(scan, c.last_velocity);
    icp = icp_.align_again(*c.map, source, icp.map_from_source, sigma, parallel);
    c.last_velocity = se3_log(last.inverse() * icp.map_from_source) / dt;
  }
  c.lost = static_cast<std::size_t>(icp.n_planar + icp.n_non_planar) < kFewest;
  if (c.lost) return;
  c.agreement += icp_.agreement(*c.map, source, icp.map_from_source, parallel);
  c.scale->add((predicted.inverse() * icp.map_from_source).translation.norm(), 1.0);
  c.poses.push_back(icp.map_from_source);
  c.map->insert(map_points_of(scan, c.last_velocity), icp.map_from_source, icp.map_from_source.translation);
}

// RMS of the change of velocity from interval to interval [m/s], stamps as they are or even, whichever is
// smoother.
double StartSearch::roughness_m_s(const std::vector<Pose>& poses) const {
  double stamped = 0.0, even = 0.0;
  Eigen::Vector3d last_stamped = Eigen::Vector3d::Zero(), last_even = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const Eigen::Vector3d step = se3_log(poses[i - 1].inverse() * poses[i]).head<3>();
    const double dt = interval_us(i);
    const Eigen::Vector3d s = step / dt,
                          e = step / (usual_interval_ * std::max(1.0, std::round(dt / usual_interval_)));
    if (i > 1) {
      stamped += (s - last_stamped).squaredNorm();
      even += (e - last_even).squaredNorm();
    }
    last_stamped = s;
    last_even = e;
  }
  const auto n = static_cast<double>(std::max<std::size_t>(3, poses.size()) - 2);
  return 1e6 * std::sqrt(std::min(stamped, even) / n);
}

// Mean agreement with the map, less what the changes of velocity make unlikely.
double StartSearch::score(const Candidate& c) const {
  if (c.lost || c.poses.size() < 2) return -std::numeric_limits<double>::infinity();
  return c.agreement / static_cast<double>(c.poses.size() - 1) -
         config_.roughness * std::log(std::max(config_.noise_m_s, roughness_m_s(c.poses)));
}

double StartSearch::distance_m(const std::vector<Pose>& a, const std::vector<Pose>& b) const {
  double most = 0.0;
  for (std::size_t i = 1; i < std::min(a.size(), b.size()); ++i)
    most = std::max(most, (a[i].translation - b[i].translation).norm());
  return most;
}

// Candidates that converged to one trajectory.
bool StartSearch::same(const Candidate& a, const Candidate& b) const {
  constexpr double kPlace = 0.1, kStep = 0.05;  // [m]
  return (a.poses.back().translation - b.poses.back().translation).norm() < kPlace &&
         usual_interval_ * (a.last_velocity - b.last_velocity).head<3>().norm() < kStep;
}

// The first intervals are biased by the candidate's starting speed. The true starting speed is extrapolated
// by a line through the later intervals, along the weakly observed direction.
Vector6d StartSearch::later_velocity(const std::vector<Pose>& poses) const {
  constexpr std::size_t kBent = 3;
  double time = 0.0, n = 0.0, t = 0.0, s = 0.0, tt = 0.0, ts = 0.0;  // sums of a line s(time)
  Vector6d first = Vector6d::Zero();
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const Vector6d v = se3_log(poses[i - 1].inverse() * poses[i]) / interval_us(i);
    if (i == 1) first = v;
    time += interval_us(i);
    if (i <= kBent) continue;
    const double speed = direction_.dot(v.head<3>());
    n += 1.0, t += time, s += speed, tt += time * time, ts += time * speed;
  }
  const double determinant = n * tt - t * t;
  if (determinant > 0.0)
    first.head<3>() += ((tt * s - t * ts) / determinant - direction_.dot(first.head<3>())) * direction_;
  return first;
}

void StartSearch::next_round() {
  std::stable_sort(candidates_.begin(), candidates_.end(),
                   [&](const Candidate& a, const Candidate& b) { return score(a) > score(b); });
  if (round_ == Round::kScreening) {
    std::vector<Candidate> best;
    for (Candidate& c : candidates_) {
      const auto like = [&](const Candidate& other) { return same(c, other); };
      if (c.lost || std::any_of(best.begin(), best.end(), like)) continue;
      best.push_back(std::move(c));
      if (best.size() == config_.finalists) break;
    }
    candidates_ = std::move(best);
    round_ = candidates_.empty() ? Round::kDone : Round::kFinal;
  } else if (round_ == Round::kFinal) {
    // Again from the final speeds of the best candidate and of the followed trajectory.
    candidates_.resize(std::min<std::size_t>(2, candidates_.size()));
    add_candidate(later_velocity(candidates_.front().poses));
    add_candidate(later_velocity(followed_));
    round_ = Round::kAgain;
  } else {
    decide();
    round_ = Round::kDone;
  }
  at_ = 0;
}

void StartSearch::decide() {
  const Candidate& best = candidates_.front();
  // Represents the followed trajectory: the best of the candidates that converged to it.
  double followed = -std::numeric_limits<double>::infinity();
  for (const Candidate& c : candidates_) {
    if (distance_m(c.poses, followed_) < config_.apart_m) followed = std::max(followed, score(c));
  }
  if (best.lost || roughness_m_s(best.poses) > config_.most_rough_m_s) return;
  if (distance_m(best.poses, followed_) < config_.apart_m) return;
  if (score(best) > followed + config_.clearly) found_ = later_velocity(best.poses);
}

}  // namespace hp2
