// The registration's settings, taken from the front-end's.
#include <algorithm>

#include "common/config.hpp"
#include "common/error.hpp"
#include "common/registration/hybrid_icp.hpp"
#include "frontend/frontend_config.hpp"

namespace hp2 {
namespace {

IcpMode mode_of(const std::string& name) {
  const auto& names = frontend_modes();
  const auto at = std::find(names.begin(), names.end(), name);
  if (at == names.end()) {
    throw Error("unknown mode \"" + name + "\"", "front-end",
                "Did you mean \"" + nearest_word(name, names) + "\"?");
  }
  constexpr IcpMode kModes[] = {IcpMode::kHybrid,     IcpMode::kPointToPoint,   IcpMode::kPointToPlane,
                                IcpMode::kFixedAlpha, IcpMode::kFixedThreshold, IcpMode::kHybrid};
  return kModes[at - names.begin()];
}

}  // namespace

IcpConfig icp_config(const FrontendConfig& c) {
  IcpConfig icp;
  icp.mode = mode_of(c.mode);
  icp.tau_ref = c.tau_ref;
  icp.n_ref = c.n_ref;
  icp.tau_min = c.tau_min;
  icp.tau_max = c.tau_max;
  icp.n_min = c.n_min;
  icp.max_iterations = c.max_iterations;
  // Point-to-point converges slowly: each step is nearly as long as the one before. With steps of 3 mm the
  // remaining error, towards the prediction, can be centimetres.
  constexpr double kCreeps = 3.0;
  icp.convergence_m = c.convergence_m / (icp.mode == IcpMode::kPointToPoint ? kCreeps : 1.0);
  const RobustConfig robust = robust_parts(c);
  icp.weak_directions = robust.weak_directions;
  icp.two_sides = robust.two_sides;
  icp.scan_lines = robust.scan_lines;
  icp.refinement = robust.refinement;
  icp.in_plane_weight = c.in_plane_weight;
  icp.weak_direction_ratio = c.weak_direction_ratio;
  icp.coarse_step_m = c.coarse_step_m;
  icp.min_eigenvalue_ratio = c.min_eigenvalue_ratio;
  return icp;
}

}  // namespace hp2
