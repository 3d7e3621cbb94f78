// The open submap: collects one point per voxel and the scans' poses until the back-end gets it (paper,
// "Local mapping").
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>
#include <tsl/robin_set.h>

#include "common/byte_io.hpp"
#include "common/registration/parallel.hpp"
#include "common/registration/voxel_key.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// Cuts the drive into submaps.
class SubmapBuilder {
 public:
  /// @param voxel_m one point per voxel of this edge is kept
  explicit SubmapBuilder(double voxel_m);

  std::int64_t id() const { return submap_.id; }
  const Pose& odom_from_submap() const { return submap_.odom_from_submap; }
  bool empty() const { return submap_.scans.empty(); }
  ScanPose& last_scan() { return submap_.scans.back(); }
  std::vector<ScanPose>& open_scans() { return submap_.scans; }
  const std::vector<ScanPose>& open_scans() const { return submap_.scans; }

  /// Adds a registered scan. A submap ends at its length, and at a scan at which tracking was lost: later
  /// scans do not fit earlier ones, so that scan's pose is the next keypose. (After only a few scans the
  /// submap goes on, and the back-end keeps the two sides apart; pieces.hpp.)
  /// @param points [m], sensor frame, deskewed
  /// @param scan   its submap_from_sensor is filled in here
  /// @param length_m the submap ends after this distance travelled in it (beta)
  /// @return the submap if this scan finished it; the next one then begins at this scan's pose
  std::optional<Submap> add(const std::vector<Eigen::Vector3f>& points, const Pose& odom_from_sensor,
                            ScanPose& scan, std::int64_t skipped_before, double length_m) {
    find_new(points, odom_from_sensor, Parallel(1));
    return add_new(odom_from_sensor, scan, skipped_before, length_m);
  }
  /// The same in two steps: the first one, which finds the points of new voxels, reads only and runs in
  /// parallel.
  void find_new(const std::vector<Eigen::Vector3f>& points, const Pose& odom_from_sensor,
                const Parallel& parallel);
  std::optional<Submap> add_new(const Pose& odom_from_sensor, ScanPose& scan, std::int64_t skipped_before,
                                double length_m, bool cut_at_loss = true);
  /// Moves the open submap in the odometry's frame.
  void move(const Pose& by) {
    submap_.odom_from_submap = by * submap_.odom_from_submap;
    last_odom_from_sensor_ = by * last_odom_from_sensor_;
  }
  /// Gives the open scans other poses, the points that came with each going along; the submap begins at the
  /// first.
  /// @param odom_from_sensor one per scan, at least one
  void move_scans(const std::vector<Pose>& odom_from_sensor);
  /// Cuts the open submap wherever it is; nothing if it holds no scan.
  std::optional<Submap> finish();

  /// Between two submaps only.
  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  // A point whose voxel had none before this scan.
  struct NewPoint {
    Eigen::Vector3f point;  // submap frame
    std::uint64_t key;
  };
  Submap cut();

  double inverse_voxel_;
  Submap submap_;
  Pose last_odom_from_sensor_;
  tsl::robin_set<std::uint64_t, VoxelKeyHash> voxels_;
  std::vector<std::vector<NewPoint>> new_points_;  // of find_new(), part by part
  std::size_t new_parts_ = 0;                      // that are filled
};

}  // namespace hp2
