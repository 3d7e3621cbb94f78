// The local map: a hash of blocks of 4x4x4 voxels.
// A voxel holds a few spread-out points, five per cache line together with their number, and their moment
// sums. A neighbourhood of 27 voxels is reached through links between blocks, with at most one hash look-up
// for all of it. Callers with many queries prefetch a few queries ahead. Every point remembers from where it
// was seen: the front and the back of a thin object are two surfaces.
#pragma once
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include <Eigen/Core>
#include <tsl/robin_map.h>

#include "common/byte_io.hpp"
#include "common/geometry/pose.hpp"
#include "common/registration/parallel.hpp"
#include "common/registration/planarity.hpp"
#include "common/registration/voxel_key.hpp"

namespace hp2 {

/// Nearest map point of a query.
struct NearestPoint {
  std::int32_t voxel = -1;  ///< Index of the voxel that holds it; -1: none in the 27 voxels.
  std::int32_t slot = 0;    ///< Which of the voxel's points.
  Eigen::Vector3f offset = Eigen::Vector3f::Zero();  ///< From the corner of the query's voxel [m].
  float distance_m = std::numeric_limits<float>::infinity();
  /// No other map point is nearer to the query than this [m]. The point stays its nearest one while the query
  /// has moved by less than other_distance_m minus its distance to the point.
  float other_distance_m = 0.0F;
};

/// Voxel-hashed local map in a fixed frame. Const members may run in parallel.
class LocalMap {
 public:
  static constexpr int kReach = (1 << 22) - 8;  ///< [voxels] Beyond it two voxels would share one key.
  /// @param voxel_size_m         edge of a voxel [m], > 0
  /// @param max_points_per_voxel a voxel takes no more points than this, 1..255
  /// @param min_spacing_m        points of one voxel are at least this far apart [m]
  /// @param wide                 where the 27 voxels around a point show no plane, take its shape from 125
  LocalMap(double voxel_size_m, int max_points_per_voxel, double min_spacing_m, bool wide = false);
  double voxel_size_m() const { return voxel_size_; }
  std::size_t point_count() const { return point_count_; }
  std::size_t voxel_count() const { return voxels_.size() - free_voxels_.size(); }
  bool empty() const { return point_count_ == 0; }

  VoxelPoint locate(const Eigen::Vector3d& p) const;

  /// Adds the points that their voxels still have room for, in their order.
  /// @param points         [m], in a sensor frame
  /// @param map_from_points their pose
  /// @param seen_from       the sensor's place [m, map frame] if it is known
  void insert(const std::vector<Eigen::Vector3f>& points, const Pose& map_from_points,
              const std::optional<Eigen::Vector3d>& seen_from = std::nullopt) {
    find_candidates(points, map_from_points, Parallel(1), seen_from);
    insert_candidates();
  }
  /// The same in two steps: the first one reads the map only and runs in parallel, the second one does not.
  void find_candidates(const std::vector<Eigen::Vector3f>& points, const Pose& map_from_points,
                       const Parallel& parallel,
                       const std::optional<Eigen::Vector3d>& seen_from = std::nullopt);
  void insert_candidates();
  /// Adds a point of a surface that the map holds from its other side only. That side's points do not exclude
  /// it, and where the voxel is full it replaces one of them.
  /// @param normal    of the surface at `p` [m], unit, either way
  /// @param seen_from where the sensor is [m]
  void insert_other_side(const Eigen::Vector3d& p, const Eigen::Vector3f& normal,
                         const Eigen::Vector3d& seen_from);
  /// Adds all points to another map, moved by `by`, as far as its voxels have room.
  void copy_points(LocalMap& to, const Pose& by = Pose()) const;
  void move(const Pose& by);  ///< Points that then find their voxel full are left out.

  /// Drops all blocks whose centre is further than `radius_m` from `centre`.
  void remove_far(const Eigen::Vector3d& centre, double radius_m);

  /// Block of the last query: the next query, if it is near, finds its block without a hash look-up. Valid
  /// until the map changes.
  struct Cursor {
    Voxel3i block = Voxel3i::Zero();
    std::int32_t index = -1;  ///< -1: none yet.
  };

  /// A query in progress.
  struct Probe {
    VoxelPoint at;
    std::int32_t block = -1;  ///< That it falls in; -1: there is none.
    std::int32_t count = 0;   ///< Of `voxels`.
    /// Occupied ones among the eight around the corner nearest to the query.
    std::array<std::int32_t, 8> voxels;
    std::array<std::uint8_t, 8> corners;  ///< Which of the eight they are.
  };
  /// Begins a query and prefetches its block. look_around() finds the voxels most likely to hold the nearest
  /// point and prefetches their points. Call both, in this order, before nearest(), better some queries
  /// ahead.
  Probe probe(const VoxelPoint& at, Cursor& cursor) const;
  void look_around(Probe& probe) const;

  /// Nearest point to a query among the 27 voxels around it.
  /// @param margin_m [m]; NearestPoint::other_distance_m may be cut at the nearest distance plus this: what
  ///                 lies beyond is not searched
  NearestPoint nearest(const Probe& query, float margin_m) const;
  NearestPoint nearest(const VoxelPoint& query) const {
    Cursor cursor;
    return nearest(query, cursor);
  }
  NearestPoint nearest(const VoxelPoint& query, Cursor& cursor) const {
    Probe p = probe(query, cursor);
    if (lines_per_voxel_ == 1) look_around(p);  // of no use for larger voxels
    return nearest(p, 0.0F);
  }

  /// Voxel index i's corner coordinates (in voxels) and point `slot`'s offset from that corner [m].
  const Voxel3i& voxel_coordinates(std::int32_t i) const {
    return voxels_[static_cast<std::size_t>(i)].coordinates;
  }
  Eigen::Vector3f point_offset(std::int32_t i, std::int32_t slot) const {
    const Line& line = lines_[static_cast<std::size_t>(i) * lines_per_voxel_ +
                              static_cast<std::size_t>(slot / kPointsPerLine)];
    return line.point(slot % kPointsPerLine);
  }

  /// Unit vector from the point to the sensor that saw it, to half a degree; zero: not known. Worth a
  /// prefetch.
  Eigen::Vector3f view(std::int32_t i, std::int32_t slot) const {
    return view_of(i, slot).head<3>().cast<float>() / kViewUnit;
  }
  /// How far from the point that sensor was [m], to half a metre and no more than 127 m; zero: not known.
  float view_distance_m(std::int32_t i, std::int32_t slot) const {
    return static_cast<float>(view_of(i, slot)[3]);
  }
  void prefetch_views(std::int32_t i) const {
    __builtin_prefetch(&views_[static_cast<std::size_t>(i) * capacity_]);
  }
  /// True if a surface was seen from one side and from the other; not if along it, or if one is not known.
  static bool other_side(const Eigen::Vector3f& normal, const Eigen::Vector3f& view,
                         const Eigen::Vector3f& other_view) {
    constexpr float kGrazing = 0.1F;
    const float a = normal.dot(view), b = normal.dot(other_view);
    return a * b < 0.0F && std::min(std::abs(a), std::abs(b)) > kGrazing;
  }
  /// Nearest to a query of the points in the 27 voxels around voxel i that are not on the other side of a
  /// surface with this normal.
  /// @param query from the voxel's corner [m]; `view`: of it; no farther than `reach_m`
  NearestPoint nearest_on_side(const Eigen::Vector3f& query, std::int32_t i, const Eigen::Vector3f& normal,
                               const Eigen::Vector3f& view, float reach_m) const;

  /// Planarity of the 27 voxels around voxel i as last computed by update_planarity().
  const Planarity& planarity(std::int32_t i) const { return planarities_[static_cast<std::size_t>(i)]; }
  /// True if voxel i's neighbourhood has changed since update_planarity(i).
  bool planarity_stale(std::int32_t i) const {
    const Voxel& voxel = voxels_[static_cast<std::size_t>(i)];
    return (blocks_[static_cast<std::size_t>(voxel.block)].stale >> voxel.cell & 1U) != 0;
  }
  /// Computes it again, or stores what analyse(neighbourhood_moments(i)) returned.
  void update_planarity(std::int32_t i) { set_planarity(i, shape(i)); }
  /// Shape of the 27 voxels around voxel i. In a wide map, of the 125 voxels where those hold too few points,
  /// or only a line.
  Planarity shape(std::int32_t i) const;
  void set_planarity(std::int32_t i, const Planarity& planarity) {
    planarities_[static_cast<std::size_t>(i)] = planarity;
    const Voxel& voxel = voxels_[static_cast<std::size_t>(i)];
    blocks_[static_cast<std::size_t>(voxel.block)].stale &= ~(std::uint64_t{1} << voxel.cell);
    all_stale_ = false;
  }
  /// Sum of the moments of the 27 voxels around voxel i, about voxel i's corner.
  /// @param wide of the 125 voxels instead
  Moments neighbourhood_moments(std::int32_t i, bool wide = false) const;

  /// Calls visit(const Eigen::Vector3d& point) for all points, in an order that depends on the history of
  /// calls alone.
  template <class Visit>
  void for_each_point(const Visit& visit) const {
    for_each_voxel([&](std::int32_t i) {
      for (std::int32_t s = 0; s < count(i); ++s) visit(point(i, s));
    });
  }
  Eigen::Vector3d point(std::int32_t i, std::int32_t slot) const {
    return voxel_coordinates(i).cast<double>() * voxel_size_ + point_offset(i, slot).cast<double>();
  }

  /// Saves all points, and reads them back: save and load give a map with the same answers, bit for bit.
  void save(ByteWriter& out) const;
  /// @throws Error if the bytes are damaged
  void load(ByteReader& in);

 private:
  static constexpr std::int32_t kPointsPerLine = 5;
  static constexpr float kNowhere = 1e15F;  // coordinate of a slot without a point: far from every query
  static constexpr float kViewUnit = 127.0F;
  // From where a point was seen: the direction, of length kViewUnit, and the distance [m]; all zero: not
  // known.
  using View = Eigen::Matrix<std::int8_t, 4, 1>;
  // A cache line of a voxel; the first one holds the number of the voxel's points.
  struct alignas(64) Line {
    std::int32_t count = 0;
    float xyz[3][kPointsPerLine];  // offsets from the voxel's corner [m]

    Line() { std::fill(&xyz[0][0], &xyz[0][0] + 3 * kPointsPerLine, kNowhere); }
    Eigen::Vector3f point(std::int32_t s) const { return {xyz[0][s], xyz[1][s], xyz[2][s]}; }
    // Squared distances of all slots to a position.
    void distances2(const Eigen::Vector3f& from, float (&d2)[kPointsPerLine]) const {
      for (std::int32_t s = 0; s < kPointsPerLine; ++s) {
        const float dx = xyz[0][s] - from.x(), dy = xyz[1][s] - from.y(), dz = xyz[2][s] - from.z();
        d2[s] = dx * dx + dy * dy + dz * dz;
      }
    }
  };
  // n, sum p, sum p p^T (xx xy xz yy yz zz) of a voxel's points about its block's centre.
  struct alignas(16) VoxelMoments {
    double v[10] = {};
  };
  struct Voxel {
    Voxel3i coordinates;
    std::int32_t block = -1;
    std::uint8_t cell = 0;  // number in its block
  };
  struct Block {
    Voxel3i coordinates;
    bool used = false;
    std::uint64_t occupied = 0, full = 0, stale = 0;  // bit c: cell c; full: has no room whatever the point
    std::array<std::int32_t, 27> neighbours;          // block indices, -1: none; 13 is the block itself
    std::array<std::int32_t, 64> cells;               // voxel indices, -1: empty
  };
  // Points of one part of the scan that their voxels may have room for.
  struct Candidates {
    std::vector<Probe> probes, candidates;
  };

  std::int32_t count(std::int32_t voxel) const {
    return lines_[static_cast<std::size_t>(voxel) * lines_per_voxel_].count;
  }
  NearestPoint nearest_of_27(const Probe& query, float margin_m) const;
  bool has_room(std::int32_t voxel, const Eigen::Vector3f& offset) const;
  Eigen::Vector3d block_centre(const Voxel3i& block) const;
  std::int32_t find_block(const Voxel3i& block) const;
  std::int32_t find_block(const Voxel3i& block, Cursor& cursor) const;
  std::int32_t add_block(const Voxel3i& block);
  void remove_block(std::int32_t b);
  // The voxel at these coordinates, in block b; created if there is none.
  std::int32_t find_or_add_voxel(const Voxel3i& coordinates, std::int32_t b);
  void add_point(std::int32_t voxel, const Eigen::Vector3f& offset, const View& view);
  void replace_point(std::int32_t voxel, std::int32_t slot, const Eigen::Vector3f& offset, const View& view);
  void set_point(std::int32_t voxel, std::int32_t slot, const Eigen::Vector3f& offset, const View& view);
  void add_moments(std::int32_t voxel, const Eigen::Vector3f& offset);
  // The voxel at any position; created if there is none.
  std::int32_t voxel_at(const Voxel3i& coordinates);
  static View quantised(const Eigen::Vector3d& to_sensor);
  const View& view_of(std::int32_t i, std::int32_t slot) const {
    return views_[static_cast<std::size_t>(i) * capacity_ + static_cast<std::size_t>(slot)];
  }
  void mark_neighbours_stale(std::int32_t voxel);
  template <class Visit>
  void for_each_voxel(const Visit& visit) const {
    for (const Block& b : blocks_) {
      if (!b.used) continue;
      for (const std::int32_t c : b.cells) {
        if (c >= 0) visit(c);
      }
    }
  }

  void prefetch_line(std::int32_t voxel) const {
    __builtin_prefetch(&lines_[static_cast<std::size_t>(voxel) * lines_per_voxel_]);
  }

  bool wide_;
  double voxel_size_, inverse_voxel_size_;
  std::size_t capacity_, lines_per_voxel_;
  double min_spacing_;
  float min_spacing2_, half_;  // half_: of a voxel's edge [m]
  std::size_t point_count_ = 0;
  bool all_stale_ = true;  // no set_planarity() since
  tsl::robin_map<std::uint64_t, std::int32_t, VoxelKeyHash> block_index_;
  std::vector<Block> blocks_;
  std::vector<std::int32_t> free_blocks_;
  std::vector<Voxel> voxels_;
  std::vector<std::int32_t> free_voxels_;
  std::vector<Line> lines_;  // lines_per_voxel_ a voxel
  std::vector<View> views_;  // capacity_ a voxel
  std::vector<VoxelMoments> moments_;
  std::vector<Planarity> planarities_;
  std::vector<std::int32_t> touched_;         // voxels that took a point in this insert()
  std::vector<Candidates> candidates_;        // of find_candidates()
  std::size_t candidate_parts_ = 0;           // that are filled
  std::optional<Eigen::Vector3d> seen_from_;  // by find_candidates()
};

}  // namespace hp2
