#include "frontend/start_search.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace hp2 {
namespace {

constexpr std::size_t kScans = 16;     // that decide
constexpr std::size_t kScreening = 7;  // after so many the unlikely candidates are given up
constexpr std::size_t kFinalists = 6;
constexpr double kDoubtful = 0.1;   // median smallest eigenvalue ratio below which the start is searched
constexpr double kSpacing_m = 0.5;  // a scan interval, from candidate to candidate: ICP reaches farther
constexpr int kSteps = 8;           // candidates to each side
// Candidates that have come to one way: the same place [m], and motion [m] in the last interval.
constexpr double kSamePlace = 0.1, kSameStep = 0.05;
constexpr double kRoughness = 0.04, kSmooth_m_s = 0.5;  // weight of the way's roughness, and its floor
constexpr double kClearly = 0.003;

Vector6d step(const Pose& from, const Pose& to) { return se3_log(from.inverse() * to); }

}  // namespace

void StartSearch::Way::add(const Track& track) {
  poses.push_back(track.last_pose());
  if (poses.size() < 2) return;
  const IcpResult& icp = track.last_registration();
  agreement += track.agreement();
  information += icp.information;
  eigenvalue_ratios.push_back(icp.min_eigenvalue_ratio);
}

void StartSearch::begin(const Track& followed) {
  end();
  base_ = followed;
  scans_.emplace_back().utime = followed.last_utime();
  followed_.add(followed);
}

bool StartSearch::add(const StampedCloud& scan, const Track& followed) {
  scans_.push_back(scan);
  followed_.add(followed);
  return scans_.size() >= kScans;
}

// Velocity in each interval [twist / us].
std::vector<Vector6d> StartSearch::velocities(const Way& way) const {
  std::vector<Vector6d> out;
  for (std::size_t i = 1; i < way.poses.size(); ++i) {
    const auto dt = static_cast<double>(scans_[i].utime - scans_[i - 1].utime);
    out.push_back(step(way.poses[i - 1], way.poses[i]) / dt);
  }
  return out;
}

// Mean agreement with the map, less what the way's jumps from interval to interval make unlikely.
double StartSearch::score(const Way& way) const {
  const auto v = velocities(way);
  double squares = 0.0;
  for (std::size_t i = 1; i < v.size(); ++i) squares += (v[i] - v[i - 1]).head<3>().squaredNorm();
  const double rough_m_s =
      1e6 * std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, v.size() - 1)));
  return way.agreement / static_cast<double>(v.size()) - kRoughness * std::log(kSmooth_m_s + rough_m_s);
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
  const auto v = velocities(way);
  const Eigen::Vector3d direction = weak_direction();
  double n = 0.0, t = 0.0, s = 0.0, tt = 0.0, ts = 0.0;  // sums of a line s(t)
  for (std::size_t i = kBent; i < v.size(); ++i) {
    const double time = static_cast<double>(scans_[i + 1].utime - scans_[0].utime);
    const double speed = direction.dot(v[i].head<3>());
    n += 1.0, t += time, s += speed, tt += time * time, ts += time * speed;
  }
  const double determinant = n * tt - t * t;
  Vector6d out = v[0];
  if (determinant > 0.0)
    out.head<3>() += ((tt * s - t * ts) / determinant - direction.dot(out.head<3>())) * direction;
  return out;
}

// Through scans_[way.poses.size()..until); from the first one on if it has not been begun.
void StartSearch::run(Candidate& candidate, std::size_t until, const Pose& first,
                      const Parallel& parallel) const {
  if (!candidate.track) {
    candidate.track = base_;
    candidate.track->start_with(first, candidate.velocity, scans_[1].duration_us, parallel);
    candidate.way = {};
    candidate.way.add(*candidate.track);
  }
  Remarks ignored;  // the track that was followed has made them
  for (std::size_t i = candidate.way.poses.size(); i < until; ++i) {
    candidate.results.push_back(candidate.track->process(scans_[i], parallel, ignored, true).odometry);
    candidate.way.add(*candidate.track);
  }
}

// The most likely candidates, each at another place after the first scans.
std::vector<StartSearch::Candidate> StartSearch::screen(const Parallel& parallel) const {
  const Eigen::Vector3d direction = weak_direction();
  const double interval = static_cast<double>(scans_.back().utime - scans_.front().utime) /
                          static_cast<double>(scans_.size() - 1);
  std::vector<Candidate> all;
  for (int k = -kSteps; k <= kSteps; ++k) {
    Candidate c;
    c.velocity.setZero();
    c.velocity.head<3>() = k * kSpacing_m / interval * direction;
    all.push_back(std::move(c));
  }
  const Pose first = base_->last_pose();
  parallel.for_blocks(all.size(), 1, [&](std::size_t i, std::size_t, std::size_t) {
    run(all[i], kScreening, first, parallel);
  });
  std::stable_sort(all.begin(), all.end(),
                   [&](const Candidate& a, const Candidate& b) { return score(a.way) > score(b.way); });
  std::vector<Candidate> kept;
  for (Candidate& c : all) {
    const auto same = [&](const Candidate& k) {
      const auto &a = c.way.poses, &b = k.way.poses;
      return (a.back().translation - b.back().translation).norm() < kSamePlace &&
             (step(a[kScreening - 2], a.back()) - step(b[kScreening - 2], b.back())).head<3>().norm() <
                 kSameStep;
    };
    if (std::any_of(kept.begin(), kept.end(), same)) continue;
    kept.push_back(std::move(c));
    if (kept.size() == kFinalists) break;
  }
  return kept;
}

// Where most scans tell the motion in all directions the first ones did, too. Where the clock does not go on
// there is no speed.
bool StartSearch::doubtful() const {
  const auto later = [](const StampedCloud& a, const StampedCloud& b) { return b.utime <= a.utime; };
  if (std::adjacent_find(scans_.begin(), scans_.end(), later) != scans_.end()) return false;
  auto ratios = followed_.eigenvalue_ratios;
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  return *middle < kDoubtful;
}

std::optional<FoundStart> StartSearch::find(const Track& followed, const Parallel& parallel) const {
  if (!doubtful()) return std::nullopt;
  const Pose first = base_->last_pose();
  const std::size_t all = scans_.size();
  std::vector<Candidate> finalists = screen(parallel);
  parallel.for_blocks(finalists.size(), 1, [&](std::size_t i, std::size_t, std::size_t) {
    run(finalists[i], all, first, parallel);
  });
  Candidate* best =
      &*std::max_element(finalists.begin(), finalists.end(),
                         [&](const Candidate& a, const Candidate& b) { return score(a.way) < score(b.way); });
  Candidate refined;
  refined.velocity = better_velocity(best->way);
  run(refined, all, first, parallel);
  if (score(refined.way) > score(best->way)) best = &refined;
  if (!(score(best->way) > score(followed_) + kClearly)) return std::nullopt;
  if (base_->begins_session()) {
    const Pose by = followed.last_pose() * best->way.poses.back().inverse();
    best->track->move(by);
    for (OdometryResult& r : best->results) r.odom_from_sensor = by * r.odom_from_sensor;
  }
  return FoundStart{std::move(*best->track), std::move(best->results)};
}

}  // namespace hp2
