// Voxel coordinates as one 64-bit number, and the hash for it.
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
