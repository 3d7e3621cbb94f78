// The 3D check of a loop candidate: two submaps registered from a guess, and every reason to doubt the
// outcome.
#pragma once
#include <vector>

#include "backend/backend_config.hpp"
#include "backend/closures/checked_submap.hpp"
#include "common/session.hpp"

namespace hp2 {

/// Smallest horizontal distance [m] between the two paths if `to` lies as the pose says.
double path_distance(const std::vector<Eigen::Vector3d>& from_path,
                     const std::vector<Eigen::Vector3d>& to_path, const Pose& from_from_to);

/// Registers `to` to `from` from `guess` and judges: convergence, distance from the guess, the odometry's
/// bound, that the paths really meet, overlap both ways, residual, that the surfaces in common fix every
/// direction, that no shifted pose within the bound explains the scene nearly as well (repeated
/// structure), and that neither submap is bent.
/// @param max_path_distance_m paths further apart than this are no revisit
/// @param guess_m, guess_rad  how far the registration may end from the guess
/// @param needed  `to` has no closure yet: a glimpse of the place will do, and says that it knows little
ClosureRecord verify_closure(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess,
                             const PoseBound& bound, double max_path_distance_m, double guess_m,
                             double guess_rad, bool needed, const BackendConfig& config);

}  // namespace hp2
