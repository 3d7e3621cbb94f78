// The two pictures of a session: trajectory.png and map_topdown.png.
#pragma once
#include <optional>
#include <string>

#include "viewer_headless/ground_truth.hpp"
#include "viewer_headless/map/map_writer.hpp"
#include "viewer_headless/session_digest.hpp"

namespace hp2 {

/// The path seen from above in the map frame [m]: odometry before and final poses after correction, ground
/// truth if there is one, accepted closures as lines between the keyposes. PNG.
std::string draw_trajectory(const SessionDigest& digest, const std::vector<ClosureRecord>& closures,
                            const std::optional<GroundTruthComparison>& truth, int width_px);

/// The map seen from above: colour is the mean height of the points in a pixel, brightness their number; the
/// trajectory over it, a scale bar and a height legend. PNG; the longer side is at most `long_side_px`.
/// @param voxel_m edge of the map's voxels: a point is drawn that large
/// @param preview if not null: the picture as a smaller JPEG
std::string draw_map(MapWriter& map, const SessionDigest& digest, double voxel_m, int long_side_px,
                     std::string* preview = nullptr);

}  // namespace hp2
