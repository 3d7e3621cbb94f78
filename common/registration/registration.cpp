#include "common/registration/registration.hpp"

#include <algorithm>

#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"
#include "common/registration/parallel.hpp"

namespace hp2 {

LocalMap registration_target(const std::vector<Eigen::Vector3f>& points, const RegistrationConfig& config) {
  // In parts: points that find their voxel full are passed over, and what is noted of the others stays small.
  constexpr std::size_t kPart = 2048;
  LocalMap map(config.voxel_size_m, config.max_points_per_voxel, config.min_spacing_m);
  std::vector<Eigen::Vector3f> part;
  for (std::size_t begin = 0; begin < points.size(); begin += kPart) {
    const auto first = points.begin() + static_cast<std::ptrdiff_t>(begin);
    part.assign(first, first + static_cast<std::ptrdiff_t>(std::min(kPart, points.size() - begin)));
    map.insert(part, Pose());
  }
  return map;
}

RegistrationResult register_clouds(const std::vector<Eigen::Vector3f>& target,
                                   const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                                   const RegistrationConfig& config, double sigma_m, double max_distance_m,
                                   int threads) {
  LocalMap map = registration_target(target, config);
  return register_cloud(map, source, guess, config, sigma_m, max_distance_m, threads);
}

RegistrationResult register_cloud(LocalMap& map, const std::vector<Eigen::Vector3f>& source,
                                  const Pose& guess, const RegistrationConfig& config, double sigma_m,
                                  double max_distance_m, int threads) {
  const Parallel parallel(threads);
  // A closure is registered once, not ten times a second: to the end.
  IcpConfig thorough = config.icp;
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
