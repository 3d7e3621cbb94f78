// The 3D check of a loop candidate: two submaps are registered from a guess, and all checks run on the
// result.
#pragma once
#include <vector>

#include "backend/backend_config.hpp"
#include "backend/closures/checked_submap.hpp"
#include "common/session.hpp"

namespace hp2 {

/// Smallest horizontal distance [m] between the two paths if `to` lies as the pose says.
double path_distance(const std::vector<Eigen::Vector3d>& from_path,
                     const std::vector<Eigen::Vector3d>& to_path, const Pose& from_from_to);

/// Registers `to` to `from` from `guess` and judges the result. It is accepted only if
/// - the registration converges near the guess and within the bound of the odometry,
/// - the paths meet, and the submaps overlap both ways with a small residual,
/// - the common surfaces determine every direction,
/// - no shifted pose within the bound agrees nearly as well (repeated structure),
/// - neither submap is bent.
/// @param max_path_distance_m paths further apart than this are no revisit
/// @param guess_m, guess_rad  how far the registration may end from the guess
/// @param needed  `to` has no closure yet: a small partial overlap will do, with a large covariance
ClosureRecord verify_closure(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess,
                             const PoseBound& bound, double max_path_distance_m, double guess_m,
                             double guess_rad, bool needed, const BackendConfig& config);

}  // namespace hp2
