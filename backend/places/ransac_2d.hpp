// Rigid alignment of two sets of matched points in the plane, most of which may be wrong.
#pragma once
#include <vector>

#include <Eigen/Core>

namespace hp2 {

/// A match between two images.
struct PointPair {
  Eigen::Vector2d reference;  ///< [m]
  Eigen::Vector2d query;      ///< [m]
};

/// reference = R(angle) query + translation.
struct Alignment2d {
  double angle = 0.0;                                     ///< [rad]
  Eigen::Vector2d translation = Eigen::Vector2d::Zero();  ///< [m]
  int inliers = 0;  ///< Matches that agree, each reference and each query point counted once; 0: none found.
};

/// RANSAC over pairs of matches with a fixed seed: the same input gives the same result.
/// @param inlier_m    distance within which a match agrees [m]
/// @param min_inliers fewer are no alignment
Alignment2d align_2d(const std::vector<PointPair>& pairs, double inlier_m, int min_inliers);

}  // namespace hp2
