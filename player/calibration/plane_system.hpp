// The linear system of one window: how its planes' residuals depend on the sensor's errors, once the planes
// and the poses of the scans are eliminated.
#pragma once
#include <cstddef>
#include <vector>

#include <Eigen/Core>

#include "player/calibration/calibration_window.hpp"

namespace hp2 {

/// The sensor's errors as they are estimated. For each ring: vertical angle, azimuth (true minus given [rad])
/// and range (measured minus true [m]). One number for all rings is the grazing error: a spot on a grazed
/// surface is detected at its near edge, range * tan(incidence) times this number too early.
struct SensorErrors {
  explicit SensorErrors(std::size_t rings);
  std::size_t rings() const { return static_cast<std::size_t>(values.size() - 1) / 3; }
  Eigen::Index angle(std::size_t ring) const { return static_cast<Eigen::Index>(ring); }
  Eigen::Index range(std::size_t ring) const { return static_cast<Eigen::Index>(rings() + ring); }
  Eigen::Index azimuth(std::size_t ring) const { return static_cast<Eigen::Index>(2 * rings() + ring); }
  Eigen::Index grazing() const { return values.size() - 1; }

  Eigen::VectorXd values;
};

/// Normal equations of a window, poses (6 per scan but the first, which is fixed; left increments) first,
/// then the errors. To be solved: information * step = gradient.
struct PlaneSystem {
  Eigen::MatrixXd poses, cross, errors;  ///< Blocks of the information.
  Eigen::VectorXd pose_gradient, error_gradient;
  std::vector<std::size_t> ring_points;  ///< Points on planes by ring.
  std::size_t patches = 0;
  double thickness_m = 0.0;  ///< Median distance of points from their plane.

  /// Eliminates the poses from `errors` and `error_gradient`. @return cross^T poses^-1
  Eigen::MatrixXd eliminate_poses();
};

/// What counts as a piece of a plane.
struct PlaneShape {
  double thickness = 0.1;   ///< Largest l3 / l2.
  double thickest_m = 1e3;  ///< Largest square root of l3.
};

/// @param correlated_points as CalibrationConfig
PlaneSystem make_plane_system(const CalibrationWindow& window, const SensorErrors& errors,
                              const PlaneShape& shape, double correlated_points);

}  // namespace hp2
