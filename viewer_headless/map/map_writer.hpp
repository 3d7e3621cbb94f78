// The map as map.ply and map.pcd, written while the points arrive: one point per voxel, one bit of memory per
// voxel.
#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <tsl/robin_map.h>

#include "common/atomic_file.hpp"
#include "common/registration/voxel_key.hpp"

namespace hp2 {

/// Which voxels were seen, in blocks of 8 x 8 x 8 bits: about 2 bytes per voxel of a surface.
class VoxelSet {
 public:
  /// @param voxel_m edge of a voxel [m]; 0: every point is new
  explicit VoxelSet(double voxel_m) : voxel_m_(voxel_m) {}
  /// True the first time that the point's voxel is seen. False for points farther than 2^20 blocks from the
  /// origin.
  bool insert(const Eigen::Vector3d& point);

 private:
  double voxel_m_;
  tsl::robin_map<std::uint64_t, std::uint32_t, VoxelKeyHash> numbers_;  // of blocks
  std::deque<std::array<std::uint64_t, 8>> blocks_;
  std::uint64_t last_key_ = 0;
  std::uint32_t last_ = 0;
};

/// Writes both files at once, binary little-endian, float x y z [m], map frame.
class MapWriter {
 public:
  /// @throws Error if the files cannot be created in `folder`
  MapWriter(const std::string& folder, double voxel_m);
  /// Takes a point if its voxel is new.
  void add(const Eigen::Vector3d& point);
  std::int64_t size() const { return count_; }
  /// Reads back all points taken so far, in order, through a buffer of fixed size. May be called again.
  void for_each(const std::function<void(const Eigen::Vector3f&)>& visit);
  /// Writes the counts and gives the files their names.
  void commit();

 private:
  void write_buffer();
  VoxelSet seen_;
  AtomicFile ply_, pcd_;
  std::string ply_header_, pcd_header_;
  std::vector<float> buffer_;
  std::int64_t count_ = 0;
};

}  // namespace hp2
