// All settings of the front-end, with their defaults. Keys of the YAML section "frontend".
#pragma once
#include <string>

#include "common/config.hpp"
#include "common/registration/hybrid_icp.hpp"

namespace hp2 {

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
  double voxel_size_m = 0.8;
  int max_points_per_voxel = 5;
  double min_spacing_m = 0.3;
  double map_point_voxel_m = 0.3;
  double source_voxel_m = 0.7;
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
  int sigma_window = 100;
  double submap_length_m = 0.0;
  double submap_voxel_m = 0.5;
};

/// The section "frontend" bound to `config`, which must outlive it.
ConfigSection frontend_section(FrontendConfig& config);

/// Settings of the registration from those of the front-end. @throws Error for an unknown mode
IcpConfig icp_config(const FrontendConfig& config);

/// Checks what ranges of single keys cannot say. @throws Error
void validate(const FrontendConfig& config);

/// Names of the modes, as `mode` takes them.
const std::vector<std::string>& frontend_modes();

}  // namespace hp2
