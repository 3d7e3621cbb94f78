// Registration of a cloud against a local map by the adaptive hybrid ICP, outside of the odometry's loop:
// what the back-end uses to verify loop closures.
#pragma once
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"
#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"

namespace hp2 {

/// Settings of a registration of two clouds.
struct RegistrationConfig {
  IcpConfig icp;
  double voxel_size_m = 0.8;  ///< Edge of the target map's voxels.
  int max_points_per_voxel = 5;
  double min_spacing_m = 0.3;  ///< Least distance between points of one voxel.
};

/// Outcome of a registration.
struct RegistrationResult {
  Pose target_from_source;
  Matrix6d information = Matrix6d::Zero();  ///< Inverse covariance of the pose, left increments (rho [m], phi
                                            ///< [rad]) in the target's frame.
  int n_planar = 0;
  int n_non_planar = 0;
  double rms_m = 0.0;  ///< RMS of the inlier correspondences' residuals (along the normal where planar).
  double inlier_ratio =
      0.0;  ///< Source points with a correspondence within `max_distance_m` at the end, 0..1.
  double min_eigenvalue_ratio = 0.0;
  int iterations = 0;
  bool converged = false;
};

/// Registers `source` to `target`, both point clouds in metres, starting from `guess` = target_from_source.
/// @param sigma_m         scale of the robust loss, also 1/3 of the first correspondence distance
/// @param max_distance_m  final inlier distance for rms_m and inlier_ratio
/// @param threads         at least 1; the result does not depend on it
RegistrationResult register_clouds(const std::vector<Eigen::Vector3f>& target,
                                   const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                                   const RegistrationConfig& config, double sigma_m, double max_distance_m,
                                   int threads = 1);
/// The same to a map of the target. Building the map costs more than a registration: use it for many sources
/// and one target. Its planarity cache is updated where it is needed.
RegistrationResult register_cloud(LocalMap& target, const std::vector<Eigen::Vector3f>& source,
                                  const Pose& guess, const RegistrationConfig& config, double sigma_m,
                                  double max_distance_m, int threads = 1);
/// Builds that map.
LocalMap registration_target(const std::vector<Eigen::Vector3f>& points, const RegistrationConfig& config);

}  // namespace hp2
