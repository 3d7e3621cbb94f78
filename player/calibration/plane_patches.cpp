#include "player/calibration/plane_patches.hpp"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <numeric>

#include <Eigen/Eigenvalues>

namespace hp2 {
namespace {

constexpr double kOutlier = 3.0;  // deviations from the plane beyond which a point is no part of a patch

using Members = std::vector<std::uint32_t>;

struct Cube {
  Eigen::Vector3i cell;
  std::uint32_t member;
};

/// Groups of `members` by cube of edge `edge_m`, in an order that depends on the points alone.
std::vector<Members> split(const std::vector<PatchPoint>& points, const Members& members, double edge_m) {
  std::vector<Cube> cubes;
  cubes.reserve(members.size());
  for (const std::uint32_t m : members)
    cubes.push_back({(points[m].position / edge_m).array().floor().cast<int>(), m});
  const auto less = [](const Cube& a, const Cube& b) {
    return std::lexicographical_compare(a.cell.data(), a.cell.data() + 3, b.cell.data(), b.cell.data() + 3);
  };
  std::stable_sort(cubes.begin(), cubes.end(), less);
  std::vector<Members> groups;
  for (std::size_t i = 0; i < cubes.size(); ++i) {
    if (i == 0 || less(cubes[i - 1], cubes[i])) groups.emplace_back();
    groups.back().push_back(cubes[i].member);
  }
  return groups;
}

class PatchFinder {
 public:
  PatchFinder(const std::vector<PatchPoint>& points, const PatchConfig& config)
      : points_(points), config_(config) {}

  std::vector<PlanePatch> run() {
    Members all(points_.size());
    std::iota(all.begin(), all.end(), 0U);
    search(all, config_.largest_edge_m);
    return std::move(patches_);
  }

 private:
  bool enough(const Members& members) const {
    if (members.size() < config_.fewest_points) return false;
    std::bitset<4096> scans;
    for (const std::uint32_t m : members) scans.set(points_[m].scan % scans.size());
    return scans.count() >= config_.fewest_scans;
  }

  void search(const Members& members, double edge_m) {
    for (const Members& group : split(points_, members, edge_m)) {
      if (!enough(group) || take(group)) continue;
      if (0.5 * edge_m >= config_.smallest_edge_m) search(group, 0.5 * edge_m);
    }
  }

  bool take(const Members& group) {
    PlanePatch patch;
    patch.members = group;
    for (int pass = 0; pass < 2; ++pass) {  // once more without the points off the plane
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (const std::uint32_t m : patch.members) mean += points_[m].position;
      mean /= static_cast<double>(patch.members.size());
      Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
      for (const std::uint32_t m : patch.members) {
        const Eigen::Vector3d d = points_[m].position - mean;
        covariance += d * d.transpose();
      }
      covariance /= static_cast<double>(patch.members.size());
      const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance);
      const Eigen::Vector3d values = eigen.eigenvalues();  // rising
      if (values[0] > config_.thickness * values[1] || values[1] < config_.elongation * values[2])
        return false;
      if (pass == 1 && values[0] > config_.thickest_m * config_.thickest_m) return false;
      patch.centre = mean;
      patch.normal = eigen.eigenvectors().col(0);
      patch.across = eigen.eigenvectors().col(1);
      patch.along = eigen.eigenvectors().col(2);
      const double limit = kOutlier * std::sqrt(values[0]) + 1e-3;
      Members kept;
      for (const std::uint32_t m : patch.members)
        if (std::abs(patch.normal.dot(points_[m].position - mean)) <= limit) kept.push_back(m);
      if (!enough(kept)) return false;
      if (pass == 0) patch.members = std::move(kept);
    }
    patches_.push_back(std::move(patch));
    return true;
  }

  const std::vector<PatchPoint>& points_;
  const PatchConfig& config_;
  std::vector<PlanePatch> patches_;
};

}  // namespace

std::vector<PlanePatch> find_patches(const std::vector<PatchPoint>& points, const PatchConfig& config) {
  return PatchFinder(points, config).run();
}

}  // namespace hp2
