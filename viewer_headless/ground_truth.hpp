// The session against its ground truth.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "common/evaluation/metrics.hpp"
#include "viewer_headless/session_digest.hpp"

namespace hp2 {

/// Scores of the final trajectory and of the odometry, over the scans whose ground truth is known.
struct GroundTruthComparison {
  std::string alignment;  ///< "se3", or "origin" where the path does not determine it (a straight line).
  Evaluation corrected, odometry;  ///< Pairs in order of `scans`.
  std::vector<std::size_t> scans;  ///< Index into SessionDigest::scans of each pair.
  Eigen::Matrix4d map_from_truth;  ///< Brings the ground truth's frame onto the map's.
};

/// Nothing without ground truth for at least two scans.
std::optional<GroundTruthComparison> compare_with_ground_truth(const SessionDigest& digest,
                                                               const std::vector<Pose>& ground_truth);

}  // namespace hp2
