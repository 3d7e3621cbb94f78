// All settings of the front-end, with their defaults. Keys of the YAML section "frontend".
#pragma once
#include <string>

#include "common/config.hpp"
#include "common/registration/hybrid_icp.hpp"
#include "common/sensor.hpp"
#include "frontend/odometry/map_scale.hpp"

namespace hp2 {

/// The parts of mode `robust`, each of which can be left out (keys `robust.NAME`). The other modes use none
/// of them: they are the paper's formulas.
struct RobustConfig {
  bool map_scale = true;            ///< Map voxels follow what is seen (map_scale.hpp).
  bool wide_neighbourhoods = true;  ///< A neighbourhood of too few points, or of a line, grows to 125 voxels.
  bool weak_directions = true;      ///< In-plane residuals support weakly observed directions.
  bool two_sides = true;            ///< Front and back of thin objects are matched apart.
  bool scan_lines = true;           ///< A line that the sensor may have drawn itself has no normal.
  bool refinement = true;           ///< A last registration with a loss as narrow as the residuals.
  bool motion_filter = true;        ///< Filtered velocities; points deskewed again by what was found.
  bool guesses = true;              ///< Registration from other guesses where predictions are far off.
  bool dropped_scans = true;        ///< A scan behind missing ones stays out of the map.
  bool start_search = true;         ///< The speed of the first scans is searched where it is weakly observed.
  bool covariance_terms = true;     ///< Covariance grows with the motion that deskewing leaves.
};

/// Settings of the registration from other guesses.
struct GuessConfig {
  double turn_rad = 0.1;             ///< From guess to guess about each axis; ICP reaches the angles between.
  int rings = 3;                     ///< Turns to each side.
  int iterations = 20;               ///< Of a guess, at most.
  std::size_t points = 1500;         ///< Registered for a guess, at most.
  double bad_fit = 0.93;             ///< Share of the usual fit below which farther turns are tried.
  double better_fit = 1.02;          ///< Another guess's fit must be better than the prediction's by this.
  double doubt_weight = 0.2;         ///< Weight of log(1 + innovation) against the fit, which is 0..1.
  double lost_inliers = 0.7;         ///< Below this share of matched points after a gap tracking is lost.
  double known_speed_sigma_m = 0.6;  ///< sigma of first scans whose speed is roughly known.
};

/// Settings of the front-end. Names follow the paper; the defaults serve every sensor (README,
/// "Configuration").
struct FrontendConfig {
  std::string mode = "robust";
  double min_range_m = 1.0;
  double max_range_m = 100.0;
  bool deskew = true;
  int redeskew_passes = 2;
  double redeskew_threshold_m = 0.05;
  double redeskew_gain = 0.7;
  double voxel_size_m = 0.0;
  int max_points_per_voxel = 5;
  double min_spacing_m = 0.0;
  double map_point_voxel_m = 0.0;
  double source_voxel_m = 0.0;
  double tau_ref = 0.2;
  double n_ref = 27.0;
  double tau_min = 0.05;
  double tau_max = 0.3;
  int n_min = 5;
  int max_iterations = 30;
  double convergence_m = 3e-3;
  double weak_direction_ratio = 0.03;
  double coarse_step_m = 0.02;
  double in_plane_weight = 0.3;
  double min_eigenvalue_ratio = 1e-4;
  double initial_sigma_m = 2.0;
  double min_sigma_m = 0.1;
  double max_sigma_m = 2.0;
  double max_sigma_share = 0.2;
  int sigma_window = 100;
  double submap_length_m = 0.0;
  double submap_voxel_m = 0.5;
  double late_scan_ratio = 1.5;  ///< Scans are missing in an interval this many times the one before.
  double degenerate_m = 0.006;  ///< `degenerate`: a weakly observed direction deviates by more than this [m].
  double incredible_surprise =
      100.0;                    ///< `degenerate` where a step is so far from the expected one (1: usual).
  double doubtful_speed = 9.0;  ///< Factor on the covariance while a weakly observed speed may be wrong.
  RobustConfig robust;
  GuessConfig guesses;
  SensorCalibration sensor;  ///< Section "sensor": every scan is corrected by it first.
};

/// The section "frontend" bound to `config`, which must outlive it.
ConfigSection frontend_section(FrontendConfig& config);

/// The parts of mode `robust` in use: all off in other modes.
RobustConfig robust_parts(const FrontendConfig& config);

/// Settings of the registration from those of the front-end. @throws Error for an unknown mode
IcpConfig icp_config(const FrontendConfig& config);

/// Sizes that go with a map voxel of this edge [m], as far as the configuration does not give them.
MapSizes map_sizes(const FrontendConfig& config, double voxel_m);

/// Checks what ranges of single keys cannot express. @throws Error
void validate(const FrontendConfig& config);

/// Names of the modes, as `mode` takes them.
const std::vector<std::string>& frontend_modes();

}  // namespace hp2
