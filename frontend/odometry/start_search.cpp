#include "frontend/odometry/start_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <Eigen/Eigenvalues>

#include "frontend/odometry/start_smoothing.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kScans = 16;     // that decide
constexpr std::size_t kScreening = 7;  // after so many the unlikely candidates are given up
constexpr std::size_t kFinalists = 6;
// Of a candidate's registration at most: from a wrong speed they would go on for long.
constexpr int kIterations = 10;
constexpr std::size_t kLeastRegistered = 8;
constexpr double kDoubtful = 0.075;  // median smallest eigenvalue ratio below which the start is searched
constexpr double kSpacing_m = 0.5;   // a scan interval, from candidate to candidate: ICP reaches farther
constexpr int kSteps = 8;            // candidates to each side
// Scans may be missing, and stamps may be off by so much of an interval; else there is no telling what is
// smooth.
constexpr double kMostIntervals = 4.0, kJitter = 0.3;
// Candidates that have come to one way: the same place [m], and motion [m] in the last interval.
constexpr double kSamePlace = 0.1, kSameStep = 0.05;
// Weight of the way's roughness, and what of it is the noise of registration: who jumps less is not smoother.
constexpr double kRoughness = 0.05, kNoise_m_s = 0.35;
// By how much a way must be better than the one followed: another one (0.014 on a highway that needs it), and
// one that lies beside it and is worth less (chance gives 0.016 in a corridor).
constexpr double kClearly = 0.009, kClearlyBeside = 0.02;

Vector6d step(const Pose& from, const Pose& to) { return se3_log(from.inverse() * to); }

// Velocity in each interval [twist / us].
std::vector<Vector6d> velocities(const std::vector<Pose>& poses, const std::vector<double>& intervals) {
  std::vector<Vector6d> out;
  for (std::size_t i = 1; i < poses.size(); ++i)
    out.push_back(step(poses[i - 1], poses[i]) / intervals[i - 1]);
  return out;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void StartSearch::Way::add(const Track& track, TrackingState state) {
  poses.push_back(track.last_pose());
  states.push_back(state);
  const IcpResult& icp = track.last_registration();
  if (poses.size() < 2 || icp.n_planar + icp.n_non_planar == 0) return;
  agreement += track.agreement();
  information += icp.information;
  eigenvalue_ratios.push_back(icp.min_eigenvalue_ratio);
}

void StartSearch::begin(const Track& followed) {
  end();
  base_ = followed;
  StampedCloud& first = scans_.emplace_back();
  first.cloud = followed.first_cloud();
  first.utime = followed.last_utime();
  followed_.add(followed, TrackingState::kTracking);
}

bool StartSearch::add(const StampedCloud& scan, TrackingState state, const Track& followed) {
  if (scans_.size() == 1) scans_.front().duration_us = scan.duration_us;
  scans_.push_back(scan);
  followed_.add(followed, state);
  return scans_.size() >= kScans;
}

StartSearch::Intervals StartSearch::stamped() const {
  Intervals out;
  for (std::size_t i = 1; i < scans_.size(); ++i)
    out.push_back(static_cast<double>(scans_[i].utime - scans_[i - 1].utime));
  return out;
}

double StartSearch::usual_interval() const { return median(stamped()); }

// As they are if the sensor turns evenly and it is the stamps that jitter.
StartSearch::Intervals StartSearch::even() const {
  Intervals out = stamped();
  const double usual = usual_interval();
  for (double& dt : out) dt = usual * std::max(1.0, std::round(dt / usual));
  return out;
}

// RMS of the change of velocity from interval to interval [m/s].
double StartSearch::roughness(const Way& way, const Intervals& intervals) {
  const auto v = velocities(way.poses, intervals);
  double squares = 0.0;
  for (std::size_t i = 1; i < v.size(); ++i) squares += (v[i] - v[i - 1]).head<3>().squaredNorm();
  return 1e6 * std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, v.size() - 1)));
}

// Mean agreement with the map, less what the way's jumps from interval to interval make unlikely.
double StartSearch::score(const Way& way) const {
  const double rough_m_s = std::min(roughness(way, stamped()), roughness(way, even()));
  return way.agreement / static_cast<double>(way.poses.size() - 1) -
         kRoughness * std::log(std::max(kNoise_m_s, rough_m_s));
}

// How far apart two ways from one first pose lie at most [m].
double StartSearch::apart(const Way& a, const Way& b) {
  double most = 0.0;
  for (std::size_t i = 1; i < a.poses.size(); ++i) {
    const Pose from_a = a.poses.front().inverse() * a.poses[i],
               from_b = b.poses.front().inverse() * b.poses[i];
    most = std::max(most, (from_a.translation - from_b.translation).norm());
  }
  return most;
}

double StartSearch::score(const Candidate& candidate) const {
  return candidate.lost ? -std::numeric_limits<double>::infinity() : score(candidate.way);
}

// In the sensor's frame at the start: along which the scans tell the motion the least.
Eigen::Vector3d StartSearch::weak_direction() const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(followed_.information.topLeftCorner<3, 3>());
  return followed_.poses.front().rotation.conjugate() * eigen.eigenvectors().col(0);
}

// The candidate's first intervals are bent by the speed that it began with; what the later ones say of the
// speed then, along the direction that was searched.
Vector6d StartSearch::better_velocity(const Way& way) const {
  constexpr std::size_t kBent = 3;
  const Intervals intervals = roughness(way, even()) < roughness(way, stamped()) ? even() : stamped();
  const auto v = velocities(way.poses, intervals);
  const Eigen::Vector3d direction = weak_direction();
  double time = 0.0, n = 0.0, t = 0.0, s = 0.0, tt = 0.0, ts = 0.0;  // sums of a line s(time)
  for (std::size_t i = 0; i < v.size(); ++i) {
    time += intervals[i];
    if (i < kBent) continue;
    const double speed = direction.dot(v[i].head<3>());
    n += 1.0, t += time, s += speed, tt += time * time, ts += time * speed;
  }
  const double determinant = n * tt - t * t;
  Vector6d out = v[0];
  if (determinant > 0.0) {
    const double speed = (tt * s - t * ts) / determinant;
    out.head<3>() += (speed - direction.dot(out.head<3>())) * direction;
  }
  return out;
}

// Through scans_[way.poses.size()..until); from the first one on if it has not been begun.
void StartSearch::run(Candidate& candidate, std::size_t until, const Parallel& parallel) const {
  if (!candidate.track) {
    candidate.track = base_;
    candidate.track->limit_iterations(kIterations);
    candidate.track->start_with(candidate.velocity, scans_[1].duration_us, parallel);
    candidate.way.add(*candidate.track, TrackingState::kTracking);
  }
  Remarks ignored;  // the track that was followed has made them
  for (std::size_t i = candidate.way.poses.size(); i < until && !candidate.lost; ++i) {
    candidate.results.push_back(candidate.track->process(scans_[i], parallel, ignored, true).odometry);
    const TrackingState state = candidate.results.back().state;
    candidate.lost = state == TrackingState::kLost && followed_.states[i] != TrackingState::kLost;
    candidate.way.add(*candidate.track, state);
  }
}

// The most likely candidates, each at another place after the first scans. A few at a time: each has a map.
std::vector<StartSearch::Candidate> StartSearch::screen(const Parallel& parallel) const {
  constexpr int kAtATime = 4;
  const Eigen::Vector3d direction = weak_direction();
  const auto same = [](const Candidate& a, const Candidate& b) {
    const Pose &at_a = a.way.poses.back(), &at_b = b.way.poses.back();
    const Vector6d change = step(a.way.poses[kScreening - 2], at_a) - step(b.way.poses[kScreening - 2], at_b);
    return (at_a.translation - at_b.translation).norm() < kSamePlace && change.head<3>().norm() < kSameStep;
  };
  std::vector<Candidate> kept;
  for (int begin = -kSteps; begin <= kSteps; begin += kAtATime) {
    const std::size_t before = kept.size();
    for (int k = begin; k < begin + kAtATime && k <= kSteps; ++k) {
      kept.emplace_back().velocity.head<3>() = k * kSpacing_m / usual_interval() * direction;
    }
    parallel.for_blocks(kept.size() - before, 1, [&](std::size_t i, std::size_t, std::size_t) {
      run(kept[before + i], kScreening, parallel);
    });
    std::stable_sort(kept.begin(), kept.end(),
                     [&](const Candidate& a, const Candidate& b) { return score(a) > score(b); });
    std::vector<Candidate> best;
    for (Candidate& c : kept) {
      const auto same_as = [&](const Candidate& other) { return same(c, other); };
      if (c.lost || std::any_of(best.begin(), best.end(), same_as)) continue;
      best.push_back(std::move(c));
      if (best.size() == kFinalists) break;
    }
    kept = std::move(best);
  }
  return kept;
}

bool StartSearch::even_times() const {
  const double usual = usual_interval();
  if (!(usual > 0.0)) return false;
  for (const double dt : stamped()) {
    const double n = std::round(dt / usual);
    if (!(n >= 1.0 && n <= kMostIntervals && std::abs(dt / usual - n) <= kJitter)) return false;
  }
  return true;
}

// Where most scans tell the motion in all directions the first ones did, too.
bool StartSearch::doubtful() const {
  const auto& ratios = followed_.eigenvalue_ratios;
  return even_times() && ratios.size() >= kLeastRegistered && median(ratios) < kDoubtful;
}

std::vector<Pose> StartSearch::smoothed(const std::vector<Pose>& poses, const Parallel& parallel) const {
  if (!even_times()) return {};
  return smoothed_start(base_->config(), scans_, poses, parallel);
}

std::optional<FoundStart> StartSearch::find(const Track& followed, const Parallel& parallel) const {
  if (!doubtful()) return std::nullopt;
  const auto keep_better = [&](std::optional<Candidate>& best, Candidate& c) {
    if (!best || score(c) > score(*best)) best = std::move(c);
  };
  // Two at a time: each has a map.
  const auto run_all = [&](std::vector<Candidate> candidates, const auto& take) {
    while (!candidates.empty()) {
      const std::size_t n = std::min<std::size_t>(2, candidates.size()), first = candidates.size() - n;
      parallel.for_blocks(n, 1, [&](std::size_t i, std::size_t, std::size_t) {
        run(candidates[first + i], scans_.size(), parallel);
      });
      for (; candidates.size() > first; candidates.pop_back()) {
        if (!candidates.back().lost) take(candidates.back());
      }
    }
  };
  struct Outcome {
    double score;
    Vector6d velocity;
  };
  std::vector<Outcome> outcomes;
  std::optional<Candidate> best;
  run_all(screen(parallel), [&](Candidate& c) {
    outcomes.push_back({score(c), better_velocity(c.way)});
    keep_better(best, c);
  });
  if (!best) return std::nullopt;
  const Vector6d velocity = better_velocity(best->way);
  const auto elsewhere = [&](const Vector6d& other) {
    return std::abs(weak_direction().dot((other - velocity).head<3>())) * usual_interval() > 0.5 * kSpacing_m;
  };
  const Outcome* other = nullptr;
  for (const Outcome& o : outcomes) {
    if (elsewhere(o.velocity) && (other == nullptr || o.score > other->score)) other = &o;
  }
  // Once more from the speed that the best of them came to, from that of the best of those that came to
  // another one, and from that of the track followed, which began blindly and with a scale to match.
  std::vector<Candidate> refined(2);
  refined[0].velocity = velocity;
  refined[1].velocity = better_velocity(followed_);
  if (other != nullptr) refined.emplace_back().velocity = other->velocity;
  std::optional<Candidate> here, there;
  run_all(std::move(refined),
          [&](Candidate& c) { keep_better(elsewhere(better_velocity(c.way)) ? there : here, c); });
  // One speed or the other is told by both attempts at it: the first may have jumped because of where it
  // began, and a way at a wrong speed does not come out as well again.
  const auto mean = [&](double first, const std::optional<Candidate>& second) {
    return second ? 0.5 * (first + score(*second)) : first;
  };
  if (there && mean(other != nullptr ? other->score : score(*there), there) > mean(score(*best), here)) {
    best = std::move(there);
  } else if (here) {
    keep_better(best, *here);
  }
  const double needed = apart(best->way, followed_) < kSpacing_m ? kClearlyBeside : kClearly;
  if (!(score(*best) > score(followed_) + needed)) return std::nullopt;
  FoundStart found{std::move(*best->track), std::move(best->results), base_->begins_session()};
  found.track.lift_limit();
  if (found.moved) {
    const Pose by = followed.last_pose() * found.track.last_pose().inverse();
    found.track.move(by);
    for (OdometryResult& r : found.results) r.odom_from_sensor = by * r.odom_from_sensor;
  }
  return found;
}

}  // namespace hp2
