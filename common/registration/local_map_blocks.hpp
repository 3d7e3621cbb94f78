// How the local map's voxels are numbered: 4x4x4 voxels per block, 27 neighbours of a voxel or a block. Used
// by local_map*.cpp only.
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

/// Which cells of which blocks the voxels around a cell are.
struct Reach {
  int blocks = 0;                        ///< At most 8.
  std::array<std::uint8_t, 8> block{};   ///< Numbers among the 27 blocks around the cell's own.
  std::array<std::uint64_t, 8> cells{};  ///< Bit c: cell c of that block.
};

/// A voxel next to a cell: which of the 27 blocks around the cell's own it is in, and which cell there.
struct Step {
  std::uint8_t block, cell;
};

struct Tables {
  std::array<Reach, 64> reach;       ///< Of the 27 voxels around each cell.
  std::array<Reach, 64> wide_reach;  ///< Of the 125 voxels around each cell.
  /// The eight voxels that meet at each corner of each cell. Bit a of a corner's number: the upper one along
  /// axis a. Bit a of a voxel's number: the neighbour along axis a instead of the cell itself.
  std::array<std::array<Step, 8>, 512> octants;

  static Reach reach_of(const Eigen::Vector3i& cell, int radius) {
    std::array<std::uint64_t, 27> cells{};
    for (int z = -radius; z <= radius; ++z) {
      for (int y = -radius; y <= radius; ++y) {
        for (int x = -radius; x <= radius; ++x) {
          const Eigen::Vector3i v = cell + Eigen::Vector3i(x, y, z);
          cells[neighbour_number(block_of(v))] |= std::uint64_t{1} << cell_of(v);
        }
      }
    }
    Reach r;
    for (std::size_t k = 0; k < 27; ++k) {
      if (cells[k] == 0) continue;
      r.block[static_cast<std::size_t>(r.blocks)] = static_cast<std::uint8_t>(k);
      r.cells[static_cast<std::size_t>(r.blocks++)] = cells[k];
    }
    return r;
  }

  Tables() {
    for (int c = 0; c < 64; ++c) {
      const Eigen::Vector3i cell(c & kMask, (c >> kBits) & kMask, c >> (2 * kBits));
      reach[static_cast<std::size_t>(c)] = reach_of(cell, 1);
      wide_reach[static_cast<std::size_t>(c)] = reach_of(cell, 2);
      for (int o = 0; o < 8; ++o) {
        for (int k = 0; k < 8; ++k) {
          Eigen::Vector3i v = cell;
          for (int a = 0; a < 3; ++a) v[a] += (k >> a & 1) * ((o >> a & 1) != 0 ? 1 : -1);
          octants[static_cast<std::size_t>(8 * c + o)][static_cast<std::size_t>(k)] = {
              static_cast<std::uint8_t>(neighbour_number(block_of(v))),
              static_cast<std::uint8_t>(cell_of(v))};
        }
      }
    }
  }
};

inline const Tables& tables() {
  static const Tables t;
  return t;
}

}  // namespace hp2::map_blocks
