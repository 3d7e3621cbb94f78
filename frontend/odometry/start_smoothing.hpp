// The first scans of a start once more, from the last to the first. A start begins blindly: at no known
// speed, deskewed by a guess, with a map of one scan. A second later all that is known, and on the way back
// it is the last of the first scans that meet a map of one scan only, but at a known speed. Between the two
// ways, each trusted the more the longer it has been under way, lie the poses.
#pragma once
#include <vector>

#include "frontend/odometry/track.hpp"

namespace hp2 {

/// @param scans a start's first ones, in order of time
/// @param poses odom_from_sensor at their ends, by the track that was followed
/// @return what these are with the way back taken in: the last one as it was, the first one by the way back
///         alone. Empty where the way back tells nothing: fewer than 8 scans, stamps that do not rise, a scan
///         without points or without times in the sweep (nobody has deskewed it, or somebody who knew the
///         motion), or a way back that leads elsewhere.
std::vector<Pose> smoothed_start(const FrontendConfig& config, const std::vector<StampedCloud>& scans,
                                 const std::vector<Pose>& poses, const Parallel& parallel);

}  // namespace hp2
