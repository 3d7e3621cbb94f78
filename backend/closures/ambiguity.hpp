// Repeated structure: is a pose beside the registered one equally likely, given what both submaps saw?
#pragma once
#include "backend/closures/checked_submap.hpp"

namespace hp2 {

/// The share of the best pose's agreement that another pose reaches within what the graph allows (and within
/// 16 m), less by up to a tenth where the graph speaks against that other one. Most shifted poses explain far
/// less and are done with at a glance; one that does not (along a corridor) is registered itself: if it
/// slides back to the best pose, there is but one.
/// @return 0 (or a little less): no other pose explains anything; 1: another one is equally likely
double ambiguity(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                 const PoseBound& bound);

}  // namespace hp2
