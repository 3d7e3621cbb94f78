#include "backend/places/ransac_2d.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <Eigen/Geometry>

namespace hp2 {
namespace {

constexpr int kMaxTrials = 2000;
constexpr int kRefinements = 3;
// Two points nearer than this many inlier distances fix no rotation.
constexpr double kMinBaseline = 4.0;

std::vector<std::size_t> inliers_of(const std::vector<PointPair>& pairs, const Alignment2d& a,
                                    double inlier_m) {
  const Eigen::Rotation2Dd r(a.angle);
  std::vector<std::size_t> inliers;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if ((r * pairs[i].query + a.translation - pairs[i].reference).squaredNorm() <= inlier_m * inlier_m) {
      inliers.push_back(i);
    }
  }
  return inliers;
}

// Least squares over the given pairs (Kabsch in the plane).
Alignment2d fit(const std::vector<PointPair>& pairs, const std::vector<std::size_t>& used) {
  Eigen::Vector2d mean_q(0, 0), mean_r(0, 0);
  for (const auto i : used) {
    mean_q += pairs[i].query;
    mean_r += pairs[i].reference;
  }
  mean_q /= static_cast<double>(used.size());
  mean_r /= static_cast<double>(used.size());
  double dot = 0.0, cross = 0.0;
  for (const auto i : used) {
    const Eigen::Vector2d q = pairs[i].query - mean_q, r = pairs[i].reference - mean_r;
    dot += q.dot(r);
    cross += q.x() * r.y() - q.y() * r.x();
  }
  Alignment2d a;
  a.angle = std::atan2(cross, dot);
  a.translation = mean_r - Eigen::Rotation2Dd(a.angle) * mean_q;
  return a;
}

// A corner matched many times over is one witness, not many.
int distinct(const std::vector<PointPair>& pairs, const std::vector<std::size_t>& used) {
  const auto less = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() != b.x() ? a.x() < b.x() : a.y() < b.y();
  };
  std::vector<Eigen::Vector2d> q, r;
  for (const auto i : used) {
    q.push_back(pairs[i].query);
    r.push_back(pairs[i].reference);
  }
  const auto count = [&](std::vector<Eigen::Vector2d>& v) {
    std::sort(v.begin(), v.end(), less);
    return static_cast<int>(std::unique(v.begin(), v.end()) - v.begin());
  };
  return std::min(count(q), count(r));
}

}  // namespace

Alignment2d align_2d(const std::vector<PointPair>& pairs, double inlier_m, int min_inliers) {
  const std::size_t n = pairs.size();
  if (n < static_cast<std::size_t>(std::max(min_inliers, 2))) return {};
  std::mt19937 rng(1);
  const std::size_t all = n * (n - 1) / 2;
  const bool exhaustive = all <= kMaxTrials;
  std::vector<std::size_t> best;
  std::size_t a = 0, b = 0;
  std::size_t trials = exhaustive ? all : kMaxTrials;
  for (std::size_t trial = 0; trial < trials; ++trial) {
    if (exhaustive) {
      if (++b >= n) b = ++a + 1;
      if (trial == 0) a = 0, b = 1;
    } else {
      a = rng() % n;
      b = rng() % n;
      if (a == b) continue;
    }
    const Eigen::Vector2d dq = pairs[b].query - pairs[a].query, dr = pairs[b].reference - pairs[a].reference;
    if (dq.norm() < kMinBaseline * inlier_m || std::abs(dq.norm() - dr.norm()) > 2.0 * inlier_m) continue;
    const auto inliers = inliers_of(pairs, fit(pairs, {a, b}), inlier_m);
    if (inliers.size() <= best.size()) continue;
    best = inliers;
    // Enough trials to have drawn two good matches at once, but for one case in 10,000.
    const double share = static_cast<double>(best.size()) / static_cast<double>(n);
    const double needed = std::log(1e-4) / std::log(std::max(1e-12, 1.0 - share * share));
    if (!exhaustive) trials = std::min(trials, trial + 1 + static_cast<std::size_t>(needed));
  }
  if (best.size() < 2) return {};
  Alignment2d result;
  for (int i = 0; i < kRefinements; ++i) {
    result = fit(pairs, best);
    const auto inliers = inliers_of(pairs, result, inlier_m);
    if (inliers.size() < 2) return {};
    best = inliers;
  }
  result.inliers = distinct(pairs, best);
  return result.inliers >= min_inliers ? result : Alignment2d{};
}

}  // namespace hp2
