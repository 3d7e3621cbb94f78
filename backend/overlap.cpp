#include "backend/overlap.hpp"

#include <cmath>

namespace hp2 {
namespace {

constexpr float kVoxel = 0.5F;            // [m]
constexpr float kColumn = 2.0F;           // [m]
constexpr double kStructureHeight = 0.4;  // [m] above the ground
constexpr int kOffset = 1 << 20;

}  // namespace

std::uint64_t VoxelCloud::voxel_key(const Eigen::Vector3i& v) {
  return (static_cast<std::uint64_t>(v.x() + kOffset) << 42) |
         (static_cast<std::uint64_t>(v.y() + kOffset) << 21) | static_cast<std::uint64_t>(v.z() + kOffset);
}

std::uint64_t VoxelCloud::column_key(const Eigen::Vector3f& p) {
  const auto x = static_cast<int>(std::floor(p.x() / kColumn)),
             y = static_cast<int>(std::floor(p.y() / kColumn));
  return (static_cast<std::uint64_t>(x + kOffset) << 21) | static_cast<std::uint64_t>(y + kOffset);
}

VoxelCloud::VoxelCloud(const std::vector<Eigen::Vector3f>& points,
                       const std::vector<Eigen::Vector3f>& normals, const Pose& ground_from_points) {
  voxels_.reserve(points.size());
  index_.reserve(points.size());
  const Eigen::RowVector3d up = ground_from_points.rotation.toRotationMatrix().row(2);
  const double height = ground_from_points.translation.z();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i];
    if (!(p.cwiseAbs().maxCoeff() < 1e5F) || !p.allFinite()) continue;
    const Eigen::Vector3i v = (p / kVoxel).array().floor().cast<int>();
    if (!index_.try_emplace(voxel_key(v), static_cast<std::int32_t>(voxels_.size())).second) continue;
    columns_.insert(column_key(p));
    const bool structure = up.dot(p.cast<double>()) + height > kStructureHeight;
    voxels_.push_back({p, i < normals.size() ? normals[i] : Eigen::Vector3f(0.0F, 0.0F, 0.0F), structure});
  }
}

const VoxelCloud::Voxel* VoxelCloud::nearest(const Eigen::Vector3f& p, float max_distance_m) const {
  const Eigen::Vector3i corner = (p / kVoxel).array().round().cast<int>() - 1;
  const Voxel* best = nullptr;
  float best2 = max_distance_m * max_distance_m;
  for (int k = 0; k < 8; ++k) {
    const auto it = index_.find(voxel_key(corner + Eigen::Vector3i(k & 1, (k >> 1) & 1, k >> 2)));
    if (it == index_.end()) continue;
    const Voxel& v = voxels_[static_cast<std::size_t>(it->second)];
    const float d2 = (v.point - p).squaredNorm();
    if (d2 <= best2) {
      best2 = d2;
      best = &v;
    }
  }
  return best;
}

Overlap overlap_of(const VoxelCloud& cloud, const VoxelCloud& other, const Pose& other_from_cloud, int stride,
                   float max_distance_m) {
  const Eigen::Matrix3f r = other_from_cloud.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = other_from_cloud.translation.cast<float>();
  Overlap o;
  int same = 0, same_structure = 0;
  for (std::size_t i = 0; i < cloud.voxels().size(); i += static_cast<std::size_t>(stride)) {
    const auto& v = cloud.voxels()[i];
    const Eigen::Vector3f p = r * v.point + t;
    if (!(p.cwiseAbs().maxCoeff() < 1e5F) || !other.seen(p)) continue;
    const bool there = other.nearest(p, max_distance_m) != nullptr;
    ++o.common;
    same += there;
    o.structure += v.structure;
    same_structure += v.structure && there;
  }
  o.all_share = o.common > 0 ? static_cast<double>(same) / o.common : 0.0;
  o.share = o.structure > 0 ? static_cast<double>(same_structure) / o.structure : 0.0;
  return o;
}

}  // namespace hp2
