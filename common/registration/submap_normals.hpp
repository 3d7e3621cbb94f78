// Normals of a submap's points.
#pragma once
#include "common/submap.hpp"

namespace hp2 {

/// Fills `submap.normals`: the unit normal of the points in the 27 voxels of 1 m around each point where they
/// are planar, zero elsewhere. It takes milliseconds, so the odometry does not call it per scan.
void estimate_normals(Submap& submap);

}  // namespace hp2
