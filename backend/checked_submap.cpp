#include "backend/checked_submap.hpp"

#include <algorithm>

#include "frontend/registration.hpp"
#include "frontend/submap_builder.hpp"

namespace hp2 {
namespace {

constexpr double kCoarseVoxel = 2.0, kCoarseSigma = 1.0;  // [m]
constexpr double kFineSigma = 0.4, kFineDistance = 0.6;   // [m]
constexpr std::size_t kCoarseSource = 2000, kFineSource = 4000;

std::vector<Eigen::Vector3f> every_nth(const std::vector<Eigen::Vector3f>& points, std::size_t most) {
  const std::size_t stride = std::max<std::size_t>(1, (points.size() + most - 1) / most);
  std::vector<Eigen::Vector3f> out;
  for (std::size_t i = 0; i < points.size(); i += stride) out.push_back(points[i]);
  return out;
}

// Another front-end may send no normals. Stored ones are of unit length to 1/127 only.
std::vector<Eigen::Vector3f> normals_of(const Submap& submap) {
  if (submap.normals.size() == submap.points.size()) {
    auto normals = submap.normals;
    for (auto& normal : normals) {
      if (normal.squaredNorm() > 0.0F) normal.normalize();
    }
    return normals;
  }
  Submap copy;
  copy.points = submap.points;
  estimate_normals(copy);
  return copy.normals;
}

}  // namespace

CheckedSubmap::CheckedSubmap(const Submap& submap, const GroundAlignment& ground_alignment)
    : id(submap.id),
      ground(ground_alignment),
      points(submap.points),
      cloud(submap.points, normals_of(submap), ground_alignment.ground_from_submap) {
  // After a loss of tracking the sensor never was at the keypose.
  const bool lost = !submap.scans.empty() && submap.scans.front().state == TrackingState::kLost;
  path.emplace_back(lost ? submap.scans.front().submap_from_sensor.translation : Eigen::Vector3d::Zero());
  for (const ScanPose& s : submap.scans) {
    if ((s.submap_from_sensor.translation - path.back()).norm() > 0.5)
      path.push_back(s.submap_from_sensor.translation);
  }
}

int stride_for(const CheckedSubmap& submap, std::size_t sample) {
  return static_cast<int>(1 + submap.cloud.voxels().size() / sample);
}

Pose register_coarse(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess) {
  FrontendConfig coarse;
  coarse.mode = "robust";
  coarse.voxel_size_m = kCoarseVoxel;
  coarse.max_points_per_voxel = 8;
  coarse.min_spacing_m = 0.6;
  return register_clouds(from.points, every_nth(to.points, kCoarseSource), guess, coarse, kCoarseSigma,
                         kCoarseSigma)
      .target_from_source;
}

Pose register_fine(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess) {
  FrontendConfig fine;
  fine.mode = "robust";
  return register_clouds(from.points, every_nth(to.points, kFineSource), guess, fine, kFineSigma,
                         kFineDistance)
      .target_from_source;
}

}  // namespace hp2
