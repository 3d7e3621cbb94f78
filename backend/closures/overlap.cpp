#include "backend/closures/overlap.hpp"

namespace hp2 {
namespace {

constexpr float kVoxel = 0.5F;  // [m]
constexpr int kBits = 2;        // of a voxel's number in a block, an axis: a block's edge is a column's
constexpr int kInBlock = (1 << kBits) - 1;
constexpr double kStructureHeight = 0.4;  // [m] above the ground

Eigen::Vector3i floor_of(const Eigen::Vector3f& p) {
  return {floor_to_int(p.x()), floor_to_int(p.y()), floor_to_int(p.z())};
}

Eigen::Vector3i voxel_of(const Eigen::Vector3f& p) { return floor_of(p / kVoxel); }

Eigen::Vector3i block_of(const Eigen::Vector3i& voxel) {
  return {voxel.x() >> kBits, voxel.y() >> kBits, voxel.z() >> kBits};
}

std::size_t cell_of(const Eigen::Vector3i& voxel) {
  return static_cast<std::size_t>(((voxel.z() & kInBlock) << kBits | (voxel.y() & kInBlock)) << kBits |
                                  (voxel.x() & kInBlock));
}

std::uint64_t column_key(const Eigen::Vector3i& block) { return voxel_key({block.x(), block.y(), 0}); }

}  // namespace

std::int32_t VoxelCloud::find_block(const Eigen::Vector3i& block) const {
  const auto it = index_.find(voxel_key(block));
  return it == index_.end() ? -1 : it->second;
}

bool VoxelCloud::seen(const Eigen::Vector3f& p) const {
  return columns_.count(column_key(block_of(voxel_of(p)))) > 0;
}

VoxelCloud::VoxelCloud(const std::vector<Eigen::Vector3f>& points,
                       const std::vector<Eigen::Vector3f>& normals, const Pose& ground_from_points) {
  voxels_.reserve(points.size());
  const Eigen::RowVector3d up = ground_from_points.rotation.toRotationMatrix().row(2);
  const double height = ground_from_points.translation.z();
  Eigen::Vector3i last = Eigen::Vector3i::Zero();  // neighbours in the cloud mostly fall into one block
  std::int32_t b = -1;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i];
    if (!(p.cwiseAbs().maxCoeff() < 1e5F) || !p.allFinite()) continue;
    const Eigen::Vector3i voxel = voxel_of(p), block = block_of(voxel);
    if (b < 0 || block != last) {
      const auto [it, is_new] =
          index_.try_emplace(voxel_key(block), static_cast<std::int32_t>(blocks_.size()));
      b = it->second;
      last = block;
      if (is_new) {
        blocks_.emplace_back().fill(-1);
        columns_.insert(column_key(block));
      }
    }
    std::int32_t& cell = blocks_[static_cast<std::size_t>(b)][cell_of(voxel)];
    if (cell >= 0) continue;
    cell = static_cast<std::int32_t>(voxels_.size());
    const bool structure = up.dot(p.cast<double>()) + height > kStructureHeight;
    voxels_.push_back({p, i < normals.size() ? normals[i] : Eigen::Vector3f(0.0F, 0.0F, 0.0F), structure});
  }
}

const VoxelCloud::Voxel* VoxelCloud::nearest(const Eigen::Vector3f& p, float max_distance_m) const {
  return search<false>(p, max_distance_m);
}

bool VoxelCloud::any_near(const Eigen::Vector3f& p, float max_distance_m) const {
  return search<true>(p, max_distance_m) != nullptr;
}

template <bool any>
const VoxelCloud::Voxel* VoxelCloud::search(const Eigen::Vector3f& p, float max_distance_m) const {
  // The corner where the eight voxels meet, and how far it is: a voxel on its other side is no nearer.
  const Eigen::Vector3i middle = floor_of(p / kVoxel + Eigen::Vector3f::Constant(0.5F));
  const Eigen::Vector3f off = p - kVoxel * middle.cast<float>(), off2 = off.cwiseAbs2();
  const int own = (off.x() >= 0.0F ? 1 : 0) | (off.y() >= 0.0F ? 2 : 0) | (off.z() >= 0.0F ? 4 : 0);
  // By axis, for the voxel below the corner and the one above: its place in its block, and whether that is
  // the next block.
  const Eigen::Vector3i corner = middle - Eigen::Vector3i::Ones(), low = block_of(corner);
  int cell_part[3][2], block_part[3][2];
  for (int a = 0; a < 3; ++a) {
    for (int side = 0; side < 2; ++side) {
      cell_part[a][side] = ((corner[a] + side) & kInBlock) << (a * kBits);
      block_part[a][side] = (((corner[a] + side) >> kBits) - low[a]) << a;
    }
  }
  constexpr std::int32_t kUnknown = -2;
  std::int32_t blocks[8] = {kUnknown, kUnknown, kUnknown, kUnknown, kUnknown, kUnknown, kUnknown, kUnknown};
  const Voxel* best = nullptr;
  float best2 = max_distance_m * max_distance_m;
  for (int k = 0; k < 8; ++k) {
    // The point's own voxel first; bits of k: the axes on which another one lies on the corner's other side.
    const float bound = ((k & 1) != 0 ? off2.x() : 0.0F) + ((k & 2) != 0 ? off2.y() : 0.0F) +
                        ((k & 4) != 0 ? off2.z() : 0.0F);
    if (bound > best2) continue;
    const int x = (own ^ k) & 1, y = (own ^ k) >> 1 & 1, z = (own ^ k) >> 2;
    const int step = block_part[0][x] | block_part[1][y] | block_part[2][z];
    std::int32_t& b = blocks[step];
    if (b == kUnknown) b = find_block(low + Eigen::Vector3i(step & 1, step >> 1 & 1, step >> 2));
    if (b < 0) continue;
    const auto c = static_cast<std::size_t>(cell_part[0][x] | cell_part[1][y] | cell_part[2][z]);
    const std::int32_t cell = blocks_[static_cast<std::size_t>(b)][c];
    if (cell < 0) continue;
    const Voxel& v = voxels_[static_cast<std::size_t>(cell)];
    const float d2 = (v.point - p).squaredNorm();
    if (d2 <= best2) {
      best2 = d2;
      best = &v;
      if (any) return best;
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
    const bool there = other.any_near(p, max_distance_m);
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
