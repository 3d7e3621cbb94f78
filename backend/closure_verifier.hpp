// The 3D check of a loop candidate: two submaps registered from a guess, and every reason to doubt the
// outcome.
#pragma once
#include <vector>

#include "backend/backend_config.hpp"
#include "backend/ground_alignment.hpp"
#include "backend/overlap.hpp"
#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// What the rest of the graph says of the pose to be measured.
struct PoseBound {
  Pose from_from_to;           ///< As the graph has it.
  double translation_m = 1e9;  ///< The truth is believed to be within this of it,
  double rotation_rad = M_PI;  ///< and this.
};

/// A submap made ready for checking.
struct CheckedSubmap {
  CheckedSubmap(const Submap& submap, const GroundAlignment& ground_alignment);

  std::int64_t id = 0;
  GroundAlignment ground;
  std::vector<Eigen::Vector3d> path;    ///< Sensor positions [m], submap frame, the keypose first.
  std::vector<Eigen::Vector3f> points;  ///< [m], submap frame.
  VoxelCloud cloud;
};

/// Smallest horizontal distance [m] between the two paths if `to` lies as the pose says.
double path_distance(const std::vector<Eigen::Vector3d>& from_path,
                     const std::vector<Eigen::Vector3d>& to_path, const Pose& from_from_to);

/// Registers `to` to `from` from `guess` and judges: convergence, distance from the guess, the odometry's
/// bound, that the paths really meet, overlap both ways, residual, that the surfaces in common fix every
/// direction, and that no shifted pose within the bound explains the scene nearly as well (repeated
/// structure).
/// @param max_path_distance_m paths further apart than this are no revisit
/// @param guess_m, guess_rad  how far the registration may end from the guess
ClosureRecord verify_closure(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess,
                             const PoseBound& bound, double max_path_distance_m, double guess_m,
                             double guess_rad, const BackendConfig& config);

}  // namespace hp2
