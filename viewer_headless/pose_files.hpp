// The text files of a session: poses, pose graph, closures. Each function gives one file's content.
#pragma once
#include <string>

#include "viewer_headless/session_digest.hpp"

namespace hp2 {

/// Final poses, map_from_sensor at the end of the sweep, one line per scan in order of sequence; KITTI
/// format.
std::string poses_kitti(const SessionDigest& digest);
/// The same in TUM format; time is the end of the sweep [s].
std::string poses_tum(const SessionDigest& digest);
/// The odometry's poses before any correction, KITTI format.
std::string poses_odometry_kitti(const SessionDigest& digest);
/// The same in TUM format.
std::string poses_odometry_tum(const SessionDigest& digest);

/// g2o: VERTEX_SE3:QUAT of the keyposes (the first one fixed), EDGE_SE3:QUAT of the odometry and the accepted
/// closures. The information's upper triangle is in g2o's own parameters (translation, then x y z of the unit
/// quaternion of measurement^-1 from^-1 to): right increments in the newer submap's frame, as ClosureRecord
/// has them, rotation vectors halved.
std::string graph_g2o(const SessionDigest& digest, const std::vector<ClosureRecord>& closures);

/// All verdicts: from_submap,to_submap,inliers,overlap,residual_m,accepted,reason,tx,ty,tz,qx,qy,qz,qw.
/// `accepted` is true or false; the pose is that of to_submap in from_submap; what was not reached is empty.
std::string closures_csv(const std::vector<ClosureRecord>& closures);

}  // namespace hp2
