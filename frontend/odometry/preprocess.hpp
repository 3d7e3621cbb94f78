// From a raw sweep to the points that are used: range crop and voxel downsampling.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "common/registration/parallel.hpp"
#include "common/scan.hpp"

namespace hp2 {

/// Settings of the preprocessing.
struct PreprocessConfig {
  double min_range_m = 1.0;
  double max_range_m = 100.0;
  double map_voxel_m = 0.3;     ///< One point per voxel of this edge is kept for the map.
  double source_voxel_m = 0.7;  ///< Of these one per voxel of this edge is registered.
};

/// The points of a sweep that are kept, in the order of firing.
struct PreprocessedScan {
  std::vector<Eigen::Vector3f> points;  ///< Sensor frame at the firing instant [m]: one per map voxel.
  std::vector<float> time;              ///< Time in sweep, one per point; empty: absent.
  std::vector<std::uint32_t> source;    ///< Indices into `points`: one per source voxel.
  double max_range_m = 0.0;             ///< Distance of the farthest of them.
  int dropped = 0;                      ///< Points of the sweep that were not finite or out of range.
};

/// Keeps the first point of each voxel. Reuses its tables from scan to scan.
class Preprocessor {
 public:
  explicit Preprocessor(const PreprocessConfig& config);

  /// From now on.
  void set_voxels(double map_voxel_m, double source_voxel_m) {
    config_.map_voxel_m = map_voxel_m;
    config_.source_voxel_m = source_voxel_m;
  }
  /// @param use_time keep scan.time (it must then hold one entry per point)
  void run(const Scan& scan, bool use_time, const Parallel& parallel, PreprocessedScan& out);

 private:
  // Set of keys of 30 bits.
  class KeySet {
   public:
    void clear(std::size_t expected);
    bool insert(std::uint32_t key);

   private:
    void grow();
    std::vector<std::uint32_t> slots_;
    std::size_t mask_ = 0, size_ = 0;
  };

  // A candidate of a part: index in the part and voxel key.
  struct Entry {
    std::uint32_t index, key;
  };
  static constexpr std::size_t kRanges = 4;  // of the keys' hashes
  static constexpr int kRecentBits = 12;
  struct Part {
    std::array<std::uint32_t, std::size_t{1} << kRecentBits> recent;  // keys that the part has had, by hash
    std::vector<std::uint32_t> scan_index;                            // of the part's candidates
    std::array<std::vector<Entry>, kRanges> map, source;  // the candidates' keys by range of their hash
    std::vector<std::uint8_t> kept;  // 0: not the first of its map voxel; 2: also of its source voxel
    std::size_t first_point = 0, first_source = 0;  // where they go in the result
    float farthest2 = 0.0F;
    int dropped = 0;
  };

  void find_candidates(const Scan& scan, std::size_t begin, std::size_t end, Part& part) const;
  void copy_out(const Scan& scan, bool use_time, Part& part, PreprocessedScan& out) const;

  PreprocessConfig config_;
  std::vector<Part> parts_;
  std::array<KeySet, kRanges> sets_;
};

}  // namespace hp2
