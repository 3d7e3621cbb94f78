#include "backend/closures/checked_submap.hpp"

#include <algorithm>
#include <utility>

#include "common/registration/registration.hpp"
#include "common/registration/submap_normals.hpp"

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

RegistrationConfig fine_config() {
  RegistrationConfig fine;
  fine.icp.weak_directions = fine.icp.two_sides = fine.icp.scan_lines = true;
  return fine;
}

RegistrationConfig coarse_config() {
  RegistrationConfig coarse = fine_config();
  coarse.voxel_size_m = kCoarseVoxel;
  coarse.max_points_per_voxel = 8;
  coarse.min_spacing_m = 0.6;
  return coarse;
}

// Another front-end may send no normals. Stored ones are of unit length to 1/127 only.
const std::vector<Eigen::Vector3f>& normals_of(Submap& submap) {
  if (submap.normals.size() != submap.points.size()) {
    estimate_normals(submap);
    return submap.normals;
  }
  for (auto& normal : submap.normals) {
    if (normal.squaredNorm() > 0.0F) normal.normalize();
  }
  return submap.normals;
}

}  // namespace

CheckedSubmap::CheckedSubmap(Submap submap, const GroundAlignment& ground_alignment)
    : id(submap.id),
      ground(ground_alignment),
      cloud(submap.points, normals_of(submap), ground_alignment.ground_from_submap) {
  points = std::move(submap.points);
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

LocalMap& CheckedSubmap::coarse_map() const {
  if (!coarse_map_) coarse_map_ = registration_target(points, coarse_config());
  return *coarse_map_;
}

LocalMap& CheckedSubmap::fine_map() const {
  if (!fine_map_) fine_map_ = registration_target(points, fine_config());
  return *fine_map_;
}

void CheckedSubmap::drop_maps() const {
  coarse_map_.reset();
  fine_map_.reset();
}

Pose register_coarse(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess) {
  return register_cloud(from.coarse_map(), every_nth(to.points, kCoarseSource), guess, coarse_config(),
                        kCoarseSigma, kCoarseSigma)
      .target_from_source;
}

Pose register_fine(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& guess) {
  return register_fine(from, every_nth(to.points, kFineSource), guess);
}

Pose register_fine(const CheckedSubmap& from, const std::vector<Eigen::Vector3f>& points, const Pose& guess) {
  return register_cloud(from.fine_map(), points, guess, fine_config(), kFineSigma, kFineDistance)
      .target_from_source;
}

}  // namespace hp2
