// Estimates a sensor's angle and range errors from a drive: those that make planes thinnest, while the poses
// of the scans and the planes themselves are free.
#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "common/registration/parallel.hpp"
#include "common/sensor.hpp"
#include "player/calibration/calibration_window.hpp"

namespace hp2 {

/// Settings of the calibration.
struct CalibrationConfig {
  // What is known before of a ring against the others, as standard deviations.
  double ring_angle_prior_deg = 0.07;
  double ring_range_prior_m = 0.03;
  double azimuth_prior_deg = 0.1;   ///< Azimuths are estimated along, but not reported.
  double grazing_prior = 1e-3;      ///< Of GrazingError, see calibrate.cpp.
  double correlated_points = 20.0;  ///< Points whose errors are one: information is divided by it.
  int most_iterations = 15;
  double settled_deg = 0.002;  ///< Change of the bias below which iterations end.
  // An estimate whose standard deviation is above these is none.
  double bias_limit_deg = 0.025;
  double angle_limit_deg = 0.025;
  double range_limit_m = 0.006;
};

/// Errors of a ring with their standard deviations.
struct RingEstimate {
  double angle_deg = 0.0, angle_sd_deg = 0.0;  ///< True minus given vertical angle, the bias included.
  double range_m = 0.0, range_sd_m = 0.0;      ///< Measured minus true range.
  std::size_t points = 0;                      ///< Points on planes, in all windows.
  bool angle_known = false, range_known = false;
};

/// What a drive tells of its sensor.
struct CalibrationEstimate {
  double bias_deg = 0.0, bias_sd_deg = 0.0;  ///< Mean error of the vertical angles.
  std::vector<RingEstimate> rings;           ///< One if rings cannot be told.
  std::size_t windows = 0, patches = 0;
  double thickness_before_m = 0.0, thickness_after_m = 0.0;  ///< Median distance of points from their plane.
  bool settled = false;
};

/// @param windows their poses are refined
/// @param rings number of rings, at least 1; points' ring numbers are below it
CalibrationEstimate calibrate(std::vector<CalibrationWindow>& windows, std::size_t rings,
                              const CalibrationConfig& config, const Parallel& parallel);

/// Why `estimate` must not be used, for people; "" if it may.
std::string doubt_about(const CalibrationEstimate& estimate, const CalibrationConfig& config);

}  // namespace hp2
