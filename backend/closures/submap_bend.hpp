// Odometry errors inside a submap bend it: no single pose aligns all of it with another submap.
#pragma once
#include "backend/closures/checked_submap.hpp"

namespace hp2 {

/// Registers the two halves of a submap, each by itself, to another submap.
/// @param from              the other submap
/// @param to                the submap; its points are in order of the scans that saw them
/// @param from_from_to      where the whole of it was registered
/// @param to_from_middle    reference of the bend: the middle of the submap's path
struct SubmapBend {
  Pose bend;          ///< Pose of the second half relative to the first; identity where registering a half
                      ///< separately does not fit better (it may not be in view).
  Pose from_from_to;  ///< Half way between the halves' poses: the best pose of the submap as a whole.
  double seen = 0.0;  ///< Share of the better half's points that have a counterpart in the other submap.
};
SubmapBend submap_bend(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                       const Pose& to_from_middle);

}  // namespace hp2
