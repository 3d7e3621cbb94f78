// Repeated structure: is a pose beside the registered one equally likely, given what both submaps saw?
#pragma once
#include "backend/closures/checked_submap.hpp"

namespace hp2 {

/// Largest agreement of a pose shifted by 2 to 16 m within the bound, as a share of the agreement at
/// `from_from_to`; reduced by up to 0.1 where the graph contradicts the shifted pose. Most shifted poses
/// agree far less, which a coarse comparison shows. One that does not (along a corridor) is registered
/// itself: if it slides back to `from_from_to`, the pose is unique.
/// @return 0 (or a little less): no other pose agrees; 1: another one is equally likely
double ambiguity(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                 const PoseBound& bound);

}  // namespace hp2
