// The result of a session: corrected trajectory, graph and closures. The back-end computes it, the viewer
// draws it.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/geometry/pose.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// The verdict on one loop candidate.
struct ClosureRecord {
  std::int64_t from_submap = 0;             ///< Older submap.
  std::int64_t to_submap = 0;               ///< Newer submap.
  Pose from_from_to;                        ///< Frame of the newer submap into that of the older one.
  Matrix6d information = Matrix6d::Zero();  ///< (rho [m], phi [rad]), right increments in the newer submap's
                                            ///< frame; zero unless it passed the 3D check.
  int inliers = 0;           ///< Of the 2D RANSAC; 0: proposed by the graph, not by image features.
  double overlap = -1.0;     ///< Of the submaps' voxels after the 3D registration, 0..1; -1: not reached.
  double residual_m = -1.0;  ///< RMS of the 3D registration; -1: not reached.
  bool accepted = false;
  std::string reason;  ///< Why not; empty if accepted.
};

/// A measured relative pose between two keyposes.
struct GraphEdge {
  std::size_t from = 0, to = 0;  ///< Submaps.
  Pose from_from_to;             ///< Frame of `to` into that of `from`.
  Matrix6d information =
      Matrix6d::Identity();  ///< Right increments (rho [m], phi [rad]) in the frame of `to`.
};

/// One scan's final pose.
struct TrajectoryPose {
  std::int64_t sequence = 0;
  std::int64_t utime = 0;   ///< End of the sweep [us].
  std::int64_t submap = 0;  ///< Submap that the scan is in.
  Pose odom_from_sensor;    ///< Before any correction.
  Pose map_from_sensor;     ///< After closures and scan-level refinement.
};

/// The state of the pose graph at one revision.
struct GraphState {
  std::int64_t revision = 0;
  bool ended = false;                      ///< The session is complete and refined.
  std::vector<Pose> map_from_submap;       ///< Keyposes, one per submap.
  Pose map_from_odom;                      ///< Of the newest submap.
  std::vector<GraphEdge> odometry;         ///< Between consecutive keyposes, as the back-end weighs it.
  std::vector<ClosureRecord> closures;     ///< All verdicts.
  std::vector<TrajectoryPose> trajectory;  ///< All scans of the finished submaps, in order of sequence.
};

}  // namespace hp2
