#include "backend/graph/derived.hpp"

#include <algorithm>

#include "backend/graph/motion_smoothing.hpp"
#include "backend/graph/pieces.hpp"
#include "backend/graph/scan_refinement.hpp"

namespace hp2 {

std::vector<GraphEdge> odometry_edges(const std::vector<Submap>& submaps) {
  std::vector<GraphEdge> edges;
  for (std::size_t k = 0; k + 1 < submaps.size(); ++k) {
    const bool known = k > 0 && !submaps[k - 1].scans.empty();
    edges.push_back(odometry_edge(submaps[k], submaps[k + 1], known ? submaps[k - 1].scans.back().utime : 0));
  }
  return edges;
}

std::vector<TrajectoryPose> final_trajectory(const std::vector<Submap>& submaps, const GraphState& graph,
                                             bool smooth) {
  std::vector<TrajectoryPose> trajectory;
  for (std::size_t k = 0; k < submaps.size() && k < graph.map_from_submap.size(); ++k) {
    append_trajectory(submaps[k], k + 1 < submaps.size() ? &submaps[k + 1] : nullptr, graph.map_from_submap,
                      trajectory);
  }
  if (smooth) smooth_trajectory(submaps, trajectory);
  return trajectory;
}

bool has_derived(const GraphState& graph, const std::vector<Submap>& submaps) {
  std::size_t scans = 0;
  for (const Submap& m : submaps) scans += m.scans.size();
  return graph.trajectory.size() == scans &&
         graph.odometry.size() + 1 == std::max<std::size_t>(submaps.size(), 1);
}

}  // namespace hp2
