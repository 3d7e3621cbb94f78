// Scan-level refinement: keyposes fixed, every scan a node, the odometry between them as edges. Between two
// fixed keyposes that graph is a chain, and its optimum has a closed form in the size of one scan's
// covariance: no solver.
#pragma once
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// Poses map_from_sensor of a submap's scans that fit the odometry best (in the sense of its covariances)
/// while the first keypose and, if given, the last scan's pose stay where they are.
/// @param scans            in order of time; poses in the submap's frame
/// @param map_from_submap  keypose of the submap
/// @param map_from_next    keypose of the submap after it, which is the last scan's pose; null: the chain's
/// end is free
std::vector<Pose> refine_scans(const std::vector<ScanPose>& scans, const Pose& map_from_submap,
                               const Pose* map_from_next);

/// Appends the final poses of a submap's scans. Where tracking was lost, each side of the gap goes with its
/// own keypose.
/// @param next            the submap after it (its scans are looked at); null: there is none
/// @param map_from_submap keyposes of all submaps
/// @param trajectory      so far; the submap before is in it
void append_trajectory(const Submap& submap, const Submap* next, const std::vector<Pose>& map_from_submap,
                       std::vector<TrajectoryPose>& trajectory);

}  // namespace hp2
