// Where tracking was lost the path falls into pieces that only a closure can join. Which scans of a submap
// its keypose holds for, and how keyposes hang together.
#pragma once
#include <cstddef>
#include <vector>

#include "backend/graph/odometry_noise.hpp"
#include "backend/graph/pose_graph.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// The scans of a submap whose points lie in the keypose's frame for certain. Where tracking was lost in a
/// submap, the larger side of the gap has the keypose; the other side goes with the submap next to it.
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

/// Moves pieces as a whole to where closures say that they are: nodes far from the optimum would not find it.
/// @param piece    one a node: number of the piece that the node is in
/// @param closures the first one between two pieces places the later one
void place_pieces(std::vector<Pose>& nodes, const std::vector<int>& piece,
                  const std::vector<GraphEdge>& closures);

}  // namespace hp2
