// Trajectory files: KITTI (12 numbers a line) and TUM (time, translation, quaternion), and pairing two of
// them.
#pragma once
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>
#include <Eigen/StdVector>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// Poses in order. Matrices as the file has them, not orthonormalised: a file of rounded numbers is scored as
/// it is, which is what evo and the KITTI devkit do.
struct Trajectory {
  std::vector<double> times_s;         ///< One a pose [s], rising; empty: not known (KITTI).
  std::vector<Eigen::Matrix4d> poses;  ///< world_from_sensor.

  std::size_t size() const { return poses.size(); }
  bool has_times() const { return !times_s.empty(); }
};

enum class TrajectoryFormat { kKitti, kTum };

/// Reads a trajectory; the format is recognised by its first data line (12 or 8 numbers, blank or comma
/// between). Lines that are empty or begin with '#' are passed over.
/// @throws Error naming file and line for a wrong number of values, one that is no finite number, a matrix
/// that is no
///         rotation (beyond 1e-3), a zero quaternion, or times that do not rise
Trajectory read_trajectory(const std::string& path);
/// The same for text; errors show `name` in place of the file.
Trajectory parse_trajectory(const std::string& text, const std::string& name);

/// The trajectory as a file's content, 12 significant digits. TUM needs times.
std::string format_trajectory(const Trajectory& trajectory, TrajectoryFormat format);
/// Writes it. @throws Error if the file cannot be written
void write_trajectory(const std::string& path, const Trajectory& trajectory, TrajectoryFormat format);

/// A trajectory of poses without times.
Trajectory make_trajectory(const std::vector<Pose>& poses);

/// How poses of two trajectories are paired.
struct AssociationOptions {
  double max_difference_s = 0.01;  ///< TUM: farthest apart that a pair's times may lie [s].
  double offset_s = 0.0;           ///< TUM: added to the estimate's times [s].
  bool common_part = false;        ///< KITTI: of two lengths, take the first poses of the longer one.
};

/// Pairs of poses of the same instants: two trajectories of one length. Both with times: every pose of the
/// shorter one with the nearest in time of the longer one (as evo does); otherwise line by line.
/// @throws Error if one has times and the other has not, if lengths differ without times (unless
/// common_part), or if
///         no pair is found; `reference_name` and `estimate_name` stand in it
std::pair<Trajectory, Trajectory> associate(const Trajectory& reference, const Trajectory& estimate,
                                            const AssociationOptions& options,
                                            const std::string& reference_name,
                                            const std::string& estimate_name);

}  // namespace hp2
