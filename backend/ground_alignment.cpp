#include "backend/ground_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <unordered_map>

#include <Eigen/Eigenvalues>

namespace hp2 {
namespace {

constexpr double kThinningVoxel = 1.0;   // [m]
constexpr double kWeightRange = 15.0;    // [m] from the path at which a point counts half
constexpr double kMaxRange = 60.0;       // [m] from the path
constexpr double kInlier = 0.2;          // [m]
constexpr double kMaxTilt = M_PI / 4.0;  // [rad]
constexpr double kMinClearance = 0.05;   // [m] of the sensor above the ground
constexpr double kPenaltyBelow =
    0.5;  // a point under the plane speaks against it half as much as one on it for it
constexpr int kTrials = 600;
constexpr int kRefinements = 6;
constexpr std::size_t kMinInliers = 30;
constexpr double kMinShare = 0.08;
constexpr double kMinSpread =
    1.0;  // [m], standard deviation of the inliers along the plane's shorter direction

struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset = 0.0;  // normal . p + offset = height above the plane
  double height(const Eigen::Vector3d& p) const { return normal.dot(p) + offset; }
};

struct Structure {
  std::vector<Eigen::Vector3d> points;
  std::vector<double> weights;
  double total = 0.0;
};

// One point (the mean) a metre voxel, weighted by how near the path it is: the wall of a house high up counts
// little against the road under the wheels.
Structure structure_near_path(const std::vector<Eigen::Vector3f>& points,
                              const std::vector<Eigen::Vector3d>& path) {
  struct Mean {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    int n = 0;
  };
  std::unordered_map<std::int64_t, std::size_t> index;
  std::vector<Mean> means;  // in the order of their first point: the result must not depend on the hash map
  for (const auto& pf : points) {
    if (!pf.allFinite() || pf.cwiseAbs().maxCoeff() > 1e5F) continue;
    const Eigen::Vector3d p = pf.cast<double>();
    const Eigen::Matrix<std::int64_t, 3, 1> v =
        (p / kThinningVoxel).array().floor().cast<std::int64_t>() + (1 << 20);
    const std::int64_t key = (v.x() << 42) | (v.y() << 21) | v.z();
    const auto [it, is_new] = index.try_emplace(key, means.size());
    if (is_new) means.emplace_back();
    means[it->second].sum += p;
    ++means[it->second].n;
  }
  // The path thinned to a point every 5 m is near enough for a weight that halves in 15 m.
  std::vector<Eigen::Vector3d> thin;
  for (const auto& p : path) {
    if (thin.empty() || (p - thin.back()).norm() > 5.0) thin.push_back(p);
  }
  if (thin.empty()) thin.emplace_back(0.0, 0.0, 0.0);
  Structure s;
  for (const Mean& m : means) {
    const Eigen::Vector3d p = m.sum / m.n;
    double d2 = kMaxRange * kMaxRange;
    for (const auto& c : thin) d2 = std::min(d2, (p - c).squaredNorm());
    if (d2 >= kMaxRange * kMaxRange) continue;
    s.points.push_back(p);
    s.weights.push_back(1.0 / (1.0 + d2 / (kWeightRange * kWeightRange)));
    s.total += s.weights.back();
  }
  return s;
}

bool below_path(const Plane& plane, const std::vector<Eigen::Vector3d>& path) {
  if (path.empty()) return plane.offset > kMinClearance;
  // A hill may lift the far end of the path's ground above the plane of its middle: most of the path will do.
  std::size_t above = 0;
  for (const auto& p : path) above += plane.height(p) > kMinClearance;
  return above * 10 >= path.size() * 9;
}

double score(const Plane& plane, const Structure& s) {
  double sum = 0.0;
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    const double h = plane.height(s.points[i]);
    if (std::abs(h) < kInlier) {
      sum += s.weights[i];
    } else if (h < -2.0 * kInlier) {
      sum -= kPenaltyBelow * s.weights[i];
    }
  }
  return sum;
}

// Plane of weighted least squares through the points near `plane`. @returns the number of points used
std::size_t refit(const Structure& s, double distance, Plane& plane, double& share, double& spread) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double weight = 0.0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    if (std::abs(plane.height(s.points[i])) >= distance) continue;
    mean += s.weights[i] * s.points[i];
    weight += s.weights[i];
    ++n;
  }
  share = s.total > 0.0 ? weight / s.total : 0.0;
  if (n < kMinInliers) return n;
  mean /= weight;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    if (std::abs(plane.height(s.points[i])) >= distance) continue;
    const Eigen::Vector3d d = s.points[i] - mean;
    covariance += s.weights[i] / weight * d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance);
  spread = std::sqrt(std::max(eigen.eigenvalues()[1], 0.0));
  plane.normal = eigen.eigenvectors().col(0);
  if (plane.normal.z() < 0.0) plane.normal = -plane.normal;
  plane.offset = -plane.normal.dot(mean);
  return n;
}

}  // namespace

GroundAlignment align_ground(const std::vector<Eigen::Vector3f>& points,
                             const std::vector<Eigen::Vector3d>& path) {
  GroundAlignment result;
  const Structure s = structure_near_path(points, path);
  const std::size_t n = s.points.size();
  if (n < kMinInliers) return result;

  const double min_cos = std::cos(kMaxTilt);
  std::mt19937 rng(1);
  Plane best;
  double best_score = 0.0;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Eigen::Vector3d& a = s.points[rng() % n];
    const Eigen::Vector3d& b = s.points[rng() % n];
    const Eigen::Vector3d& c = s.points[rng() % n];
    Eigen::Vector3d normal = (b - a).cross(c - a);
    const double area = normal.norm();
    if (area < 4.0) continue;  // [m^2]: too small a triangle says little of the slope
    normal /= normal.z() < 0.0 ? -area : area;
    if (normal.z() < min_cos) continue;
    const Plane plane{normal, -normal.dot(a)};
    if (!below_path(plane, path)) continue;
    const double value = score(plane, s);
    if (value > best_score) {
      best_score = value;
      best = plane;
    }
  }
  if (best_score <= 0.0) return result;

  std::size_t inliers = 0;
  double spread = 0.0;
  for (int i = 0; i < kRefinements; ++i) inliers = refit(s, kInlier, best, result.inlier_share, spread);
  if (inliers < kMinInliers || result.inlier_share < kMinShare || spread < kMinSpread ||
      best.normal.z() < min_cos || !below_path(best, path)) {
    return result;
  }
  result.found = true;
  // The smallest rotation that takes the plane's normal to z keeps the heading; the origin drops to the plane
  // below it.
  const Eigen::Quaterniond up = Eigen::Quaterniond::FromTwoVectors(best.normal, Eigen::Vector3d::UnitZ());
  result.ground_from_submap = Pose(up, Eigen::Vector3d(0.0, 0.0, best.offset));
  return result;
}

}  // namespace hp2
