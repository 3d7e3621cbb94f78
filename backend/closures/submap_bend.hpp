// Odometry that erred inside a submap has bent it: no single pose lays all of it on what another submap saw.
#pragma once
#include "backend/closures/checked_submap.hpp"

namespace hp2 {

/// Registers the two halves of a submap, each by itself, to another submap.
/// @param from              the other submap
/// @param to                the submap; its points are in order of the scans that saw them
/// @param from_from_to      where the whole of it was registered
/// @param to_from_middle    where the bend is to be told: the middle of the submap's path
struct SubmapBend {
  Pose bend;          ///< Pose of the second half as the first one sees it; identity where a pose of its own
                      ///< explains neither half better (it may not be in view).
  Pose from_from_to;  ///< Half way between the halves' poses: what is true of the submap as a whole.
  double seen =
      0.0;  ///< Share of the points of the half that agrees better that the other submap has there too.
};
SubmapBend submap_bend(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                       const Pose& to_from_middle);

}  // namespace hp2
