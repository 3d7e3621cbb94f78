#include "viewer_headless/ground_truth.hpp"

#include <Eigen/LU>

#include "common/error.hpp"

namespace hp2 {

std::optional<GroundTruthComparison> compare_with_ground_truth(const SessionDigest& digest,
                                                               const std::vector<Pose>& ground_truth) {
  GroundTruthComparison out;
  std::vector<Pose> truth, corrected, odometry;
  for (std::size_t i = 0; i < digest.scans.size(); ++i) {
    const ScanRecord& scan = digest.scans[i];
    if (scan.sequence < 0 || static_cast<std::size_t>(scan.sequence) >= ground_truth.size()) continue;
    const Pose& pose = ground_truth[static_cast<std::size_t>(scan.sequence)];
    if (!pose.is_finite() || !scan.map_from_sensor.is_finite() || !scan.odom_from_sensor.is_finite())
      continue;
    out.scans.push_back(i);
    truth.push_back(pose);
    corrected.push_back(scan.map_from_sensor);
    odometry.push_back(scan.odom_from_sensor);
  }
  if (truth.size() < 2) return std::nullopt;
  const Trajectory reference = make_trajectory(truth), estimate = make_trajectory(corrected);
  Alignment alignment = Alignment::kSe3;
  Eigen::Matrix4d truth_from_map;
  try {
    truth_from_map = alignment_transform(reference, estimate, alignment);
    out.odometry = evaluate(reference, make_trajectory(odometry), alignment);
  } catch (const Error&) {
    alignment = Alignment::kOrigin;
    truth_from_map = alignment_transform(reference, estimate, alignment);
    out.odometry = evaluate(reference, make_trajectory(odometry), alignment);
  }
  out.alignment = alignment == Alignment::kSe3 ? "se3" : "origin";
  out.corrected = evaluate(reference, estimate, alignment);
  out.map_from_truth = truth_from_map.inverse();
  return out;
}

}  // namespace hp2
