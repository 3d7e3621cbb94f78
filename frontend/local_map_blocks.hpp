// How the local map's voxels are numbered: 4x4x4 voxels a block, 27 neighbours of a voxel or a block. Used by
// local_map*.cpp only.
#pragma once
#include <array>
#include <cstdint>

#include <Eigen/Core>

namespace hp2::map_blocks {

constexpr int kBits = 2;  ///< A block has 2^kBits voxels along each axis.
constexpr int kMask = (1 << kBits) - 1;

/// The block that voxel v is in.
inline Eigen::Vector3i block_of(const Eigen::Vector3i& v) {
  return {v.x() >> kBits, v.y() >> kBits, v.z() >> kBits};
}

/// Its number 0..63 there.
inline int cell_of(const Eigen::Vector3i& v) {
  return (v.x() & kMask) | ((v.y() & kMask) << kBits) | ((v.z() & kMask) << (2 * kBits));
}

/// Offset of neighbour number 0..26; number 13 is the voxel (or block) itself.
inline Eigen::Vector3i neighbour_offset(int k) { return {k % 3 - 1, (k / 3) % 3 - 1, k / 9 - 1}; }

/// Number of the neighbour at an offset of -1, 0 or 1 along each axis.
inline std::size_t neighbour_number(const Eigen::Vector3i& offset) {
  return static_cast<std::size_t>((offset.x() + 1) + 3 * (offset.y() + 1) + 9 * (offset.z() + 1));
}

/// For a cell of a block and one of its 27 neighbours: which of the 27 blocks it is in, and which cell there.
struct Step {
  std::uint8_t block, cell;
};

struct Tables {
  std::array<std::array<Step, 27>, 64> steps;

  Tables() {
    for (int c = 0; c < 64; ++c) {
      const Eigen::Vector3i cell(c & kMask, (c >> kBits) & kMask, c >> (2 * kBits));
      for (int k = 0; k < 27; ++k) {
        const Eigen::Vector3i v = cell + neighbour_offset(k);
        steps[static_cast<std::size_t>(c)][static_cast<std::size_t>(k)] = {
            static_cast<std::uint8_t>(neighbour_number(block_of(v))), static_cast<std::uint8_t>(cell_of(v))};
      }
    }
  }
};

inline const Tables& tables() {
  static const Tables t;
  return t;
}

}  // namespace hp2::map_blocks
