// Voxel coordinates: of a point, and as one 64-bit number with the hash for it.
#pragma once
#include <cstddef>
#include <cstdint>

#include <Eigen/Core>

namespace hp2 {

/// The whole number below `x`, which an int must hold. std::floor() is a call on processors without SSE 4.1.
inline int floor_to_int(float x) {
  const auto truncated = static_cast<int>(x);
  return truncated - (x < static_cast<float>(truncated) ? 1 : 0);
}

using Voxel3i = Eigen::Vector3i;

/// Integer voxel of a coordinate and the rest [m] above the voxel's corner, exact for maps of any extent.
struct VoxelPoint {
  Voxel3i voxel;
  Eigen::Vector3f offset;  ///< In [0, voxel size).
};

/// The voxel of a point given from the corner of voxel `origin` [m], in floats: exact to their digits within
/// some hundred metres of it.
inline VoxelPoint locate_near(const Eigen::Vector3f& p, const Voxel3i& origin, float edge,
                              float inverse_edge) {
  VoxelPoint at;
  for (int a = 0; a < 3; ++a) {
    const int v = floor_to_int(p[a] * inverse_edge);
    at.voxel[a] = v + origin[a];
    at.offset[a] = p[a] - static_cast<float>(v) * edge;
  }
  return at;
}

/// Packs three coordinates in [-2^20, 2^20) into one number; farther ones wrap around.
inline std::uint64_t voxel_key(const Eigen::Vector3i& v) {
  constexpr std::uint64_t mask = (std::uint64_t{1} << 21) - 1;
  return ((static_cast<std::uint64_t>(v.x()) & mask) << 42) |
         ((static_cast<std::uint64_t>(v.y()) & mask) << 21) | (static_cast<std::uint64_t>(v.z()) & mask);
}

/// Spreads neighbouring keys over a table of a power of two of buckets (the identity would cluster them).
struct VoxelKeyHash {
  std::size_t operator()(std::uint64_t k) const {
    k ^= k >> 31;
    k *= 0x9E3779B97F4A7C15ULL;
    return static_cast<std::size_t>(k ^ (k >> 29));
  }
};

}  // namespace hp2
