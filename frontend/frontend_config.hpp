// All settings of the front-end, with their defaults. Keys of the YAML section "frontend".
#pragma once
#include <string>

#include "common/config.hpp"

namespace hp2 {

/// Settings of the front-end. Names follow the paper.
struct FrontendConfig {
  std::string mode = "hybrid";
  double min_range_m = 1.0;
  double max_range_m = 100.0;
  bool deskew = true;
  double voxel_size_m = 0.6;
  double tau_ref = 0.2;
  double n_ref = 27;
  double tau_min = 0.05;
  double tau_max = 0.3;
  int n_min = 5;
  double submap_length_m = 100.0;
};

/// The section "frontend" bound to `config`.
ConfigSection frontend_section(FrontendConfig& config);

}  // namespace hp2
