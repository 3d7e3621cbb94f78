#include "backend/places/ground_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <utility>

#include <Eigen/Eigenvalues>
#include <tsl/robin_map.h>

#include "common/registration/simd.hpp"
#include "common/registration/voxel_key.hpp"

namespace hp2 {
namespace {

constexpr float kThinningVoxel = 1.0F;   // [m]
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

// The same for the trials: the weightiest points first, coordinate by coordinate. Few points show that a
// plane is worse than the best one so far.
struct Jury {
  std::vector<float> x, y, z, weight;
  std::vector<float> left;  // weight of all points from this part on
};
constexpr std::size_t kPart = 256;  // points

Jury jury_of(const Structure& s) {
  std::vector<std::pair<float, std::uint32_t>> order;
  for (std::size_t i = 0; i < s.points.size(); ++i) {
    order.emplace_back(-static_cast<float>(s.weights[i]), static_cast<std::uint32_t>(i));
  }
  std::sort(order.begin(), order.end());
  Jury jury;
  const std::size_t parts = (order.size() + kPart - 1) / kPart;
  // What fills up the last part weighs nothing.
  for (auto* v : {&jury.x, &jury.y, &jury.z, &jury.weight}) v->assign(parts * kPart, 0.0F);
  jury.left.assign(parts + 1, 0.0F);
  for (std::size_t i = order.size(); i-- > 0;) {
    const Eigen::Vector3f p = s.points[order[i].second].cast<float>();
    jury.x[i] = p.x();
    jury.y[i] = p.y();
    jury.z[i] = p.z();
    jury.weight[i] = -order[i].first;
    jury.left[i / kPart] += jury.weight[i];
    if (i % kPart == 0 && i > 0) jury.left[i / kPart - 1] = jury.left[i / kPart];
  }
  return jury;
}

// One point (the mean) a metre voxel, weighted by how near the path it is: the wall of a house high up counts
// little against the road under the wheels.
Structure structure_near_path(const std::vector<Eigen::Vector3f>& points,
                              const std::vector<Eigen::Vector3d>& path) {
  struct Mean {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    int n = 0;
  };
  tsl::robin_map<std::uint64_t, std::size_t, VoxelKeyHash> index;
  Eigen::Vector3i last = Eigen::Vector3i::Zero();
  std::size_t mean = 0;
  std::vector<Mean> means;  // in the order of their first point: the result must not depend on the hash map
  for (const auto& pf : points) {
    if (!pf.allFinite() || pf.cwiseAbs().maxCoeff() > 1e5F) continue;
    const Eigen::Vector3f v = pf / kThinningVoxel;
    const Eigen::Vector3i voxel(floor_to_int(v.x()), floor_to_int(v.y()), floor_to_int(v.z()));
    // Neighbours in the cloud are mostly in one voxel.
    if (means.empty() || voxel != last) {
      const auto [it, is_new] = index.try_emplace(voxel_key(voxel), means.size());
      if (is_new) means.emplace_back();
      mean = it->second;
      last = voxel;
    }
    means[mean].sum += pf.cast<double>();
    ++means[mean].n;
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

// What speaks for the plane; less than that, but no more than `enough`, where it cannot be more than
// `enough`.
double score(const Plane& plane, const Jury& jury, double enough) {
  const Eigen::Vector3f n = plane.normal.cast<float>();
  const auto offset = static_cast<float>(plane.offset);
  constexpr auto kNear2 = static_cast<float>(kInlier * kInlier), kBelow = static_cast<float>(-2.0 * kInlier),
                 kPenalty = static_cast<float>(kPenaltyBelow);
  const Float4 nothing = {0.0F, 0.0F, 0.0F, 0.0F};
  double sum = 0.0;
  for (std::size_t part = 0; part + 1 < jury.left.size(); ++part) {
    if (sum + static_cast<double>(jury.left[part]) <= enough) return sum;
    Float4 votes = nothing;
    for (std::size_t i = part * kPart; i < (part + 1) * kPart; i += 4) {
      const Float4 h =
          n.x() * load4(&jury.x[i]) + n.y() * load4(&jury.y[i]) + n.z() * load4(&jury.z[i]) + offset;
      const Float4 weight = load4(&jury.weight[i]);
      votes += h * h < kNear2 ? weight : (h < kBelow ? -kPenalty * weight : nothing);
    }
    sum += static_cast<double>(sum4(votes));
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
  const Jury jury = jury_of(s);
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
    const double value = score(plane, jury, best_score);
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
