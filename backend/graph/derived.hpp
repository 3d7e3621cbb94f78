// Derived from a session's submaps and keyposes: the odometry's edges and every scan's final pose. Computed
// here and nowhere else, then stored and sent.
#pragma once
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// Edges between consecutive submaps with the odometry's information.
/// @param submaps all of the session, in order; their points are not looked at
std::vector<GraphEdge> odometry_edges(const std::vector<Submap>& submaps);

/// Poses of all scans from the keyposes `graph.map_from_submap`.
/// @param smooth as the end of a session does (BackendConfig::smooth_scans)
std::vector<TrajectoryPose> final_trajectory(const std::vector<Submap>& submaps, const GraphState& graph,
                                             bool smooth);

/// Whether a graph read from a session has its edges and trajectory. Sessions of version 3 and older do not,
/// and damaged records are left out.
/// @param submaps all of the session
bool has_derived(const GraphState& graph, const std::vector<Submap>& submaps);

}  // namespace hp2
