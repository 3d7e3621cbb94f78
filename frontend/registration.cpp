#include "frontend/registration.hpp"

#include <algorithm>

#include "frontend/hybrid_icp.hpp"
#include "frontend/local_map.hpp"
#include "frontend/parallel.hpp"

namespace hp2 {

RegistrationResult register_clouds(const std::vector<Eigen::Vector3f>& target,
                                   const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                                   const FrontendConfig& config, double sigma_m, double max_distance_m,
                                   int threads) {
  const Parallel parallel(threads);
  LocalMap map(config.voxel_size_m, config.max_points_per_voxel, config.min_spacing_m);
  map.insert(target, Pose());
  // A closure is registered once, not ten times a second: to the end.
  IcpConfig thorough = icp_config(config);
  thorough.convergence_m = std::min(thorough.convergence_m, 1e-3);
  HybridIcp icp(thorough);
  // Coarse first, then with the final inlier distance, so that the figures speak of the latter.
  const IcpResult coarse = icp.align(map, source, guess, sigma_m, parallel);
  const IcpResult fine = icp.align(map, source, coarse.map_from_source, max_distance_m / 3.0, parallel);
  RegistrationResult r;
  r.target_from_source = fine.map_from_source;
  r.information = fine.information;
  r.n_planar = fine.n_planar;
  r.n_non_planar = fine.n_non_planar;
  r.rms_m = fine.rms_m;
  r.inlier_ratio = fine.inlier_ratio;
  r.min_eigenvalue_ratio = fine.min_eigenvalue_ratio;
  r.iterations = coarse.iterations + fine.iterations;
  r.converged = fine.converged;
  return r;
}

}  // namespace hp2
