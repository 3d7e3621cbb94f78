// Where tracking was lost the trajectory falls into pieces that only a closure can join. Which scans of a
// submap belong to its keypose, and how keyposes are connected.
#pragma once
#include <cstddef>
#include <vector>

#include "backend/graph/odometry_noise.hpp"
#include "backend/graph/pose_graph.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// The scans of a submap that are consistent with its keypose. Where tracking was lost in a submap, the
/// larger side of the gap has the keypose; the other side belongs to the neighbouring submap.
struct AnchoredScans {
  std::size_t begin = 0, end = 0;  ///< Scans [begin, end).
  bool starts_piece = false;  ///< A loss lies before them: the submap before does not end at this keypose.
  bool ends_piece = false;    ///< A loss lies after them: the submap after does not begin at their end.
};
AnchoredScans anchored_scans(const std::vector<ScanPose>& scans);

/// The submap with its anchored scans and their points alone; others as they are.
Submap anchored_submap(Submap submap);

/// Edge between the keyposes of `submap` and of the one after it. Where tracking was lost between them, it
/// has next to no information.
/// @param utime_before end of the sweep before the submap's first one [us]; 0: unknown
GraphEdge odometry_edge(const Submap& submap, const Submap& next, std::int64_t utime_before);

/// Moves pieces as a whole to where closures place them: from far away the optimiser would not converge.
/// @param piece    one per node: number of the piece that the node is in
/// @param closures the first one between two pieces places the later one
void place_pieces(std::vector<Pose>& nodes, const std::vector<int>& piece,
                  const std::vector<GraphEdge>& closures);

}  // namespace hp2
