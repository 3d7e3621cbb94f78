#include "frontend/odometry/submap_builder.hpp"

#include <cmath>
#include <utility>

namespace hp2 {
namespace {

// Scans before a loss that are worth a submap of their own. Where tracking comes and goes from scan to scan
// there would be one per scan otherwise.
constexpr std::size_t kWorthASubmap = 10;

std::uint64_t key_of(const Eigen::Vector3f& p, float inverse_voxel) {
  return voxel_key((p * inverse_voxel).array().floor().cast<int>());
}

double path_m(const std::vector<ScanPose>& scans) {
  double sum = 0.0;
  for (std::size_t i = 1; i < scans.size(); ++i) {
    sum += (scans[i].submap_from_sensor.translation - scans[i - 1].submap_from_sensor.translation).norm();
  }
  return sum;
}

}  // namespace

SubmapBuilder::SubmapBuilder(double voxel_m) : inverse_voxel_(1.0 / voxel_m) {}

void SubmapBuilder::find_new(const std::vector<Eigen::Vector3f>& points, const Pose& odom_from_sensor,
                             const Parallel& parallel) {
  constexpr std::size_t kPart = 1024;
  const Pose submap_from_sensor = submap_.odom_from_submap.inverse() * odom_from_sensor;
  const Eigen::Matrix3f r = submap_from_sensor.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = submap_from_sensor.translation.cast<float>();
  const auto inverse_voxel = static_cast<float>(inverse_voxel_);
  new_parts_ = Parallel::block_count(points.size(), kPart);
  if (new_points_.size() < new_parts_) new_points_.resize(new_parts_);
  parallel.for_blocks(points.size(), kPart, [&](std::size_t part, std::size_t begin, std::size_t end) {
    auto& found = new_points_[part];
    found.clear();
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3f p = r * points[i] + t;
      const std::uint64_t key = key_of(p, inverse_voxel);
      if (voxels_.count(key) == 0) found.push_back({p, key});
    }
  });
}

std::optional<Submap> SubmapBuilder::add_new(const Pose& odom_from_sensor, ScanPose& scan,
                                             std::int64_t skipped_before, double length_m, bool cut_at_loss) {
  scan.submap_from_sensor = submap_.odom_from_submap.inverse() * odom_from_sensor;
  const bool first_of_session = submap_.id == 0 && submap_.scans.empty();
  const bool lost_here = scan.state == TrackingState::kLost &&
                         (submap_.scans.empty() || submap_.scans.back().state != TrackingState::kLost);
  // The motion to a scan at which tracking was lost is a guess, and does not count as travelled.
  if (!first_of_session && !lost_here) {
    submap_.travelled_m += (odom_from_sensor.translation - last_odom_from_sensor_.translation).norm();
  }
  last_odom_from_sensor_ = odom_from_sensor;
  submap_.scans_skipped += skipped_before;

  const auto index = static_cast<std::int32_t>(submap_.scans.size());
  for (std::size_t part = 0; part < new_parts_; ++part) {
    for (const NewPoint& found : new_points_[part]) {
      if (!voxels_.insert(found.key).second) continue;
      submap_.points.push_back(found.point);
      submap_.scan_indices.push_back(index);
    }
  }
  new_parts_ = 0;
  submap_.scans.push_back(scan);
  const bool lost_part = cut_at_loss && lost_here && submap_.scans.size() > kWorthASubmap;
  if (submap_.travelled_m < length_m && !lost_part) return std::nullopt;
  return cut();
}

void SubmapBuilder::move_scans(const std::vector<Pose>& odom_from_sensor) {
  submap_.odom_from_submap = odom_from_sensor.front();
  last_odom_from_sensor_ = odom_from_sensor.back();
  const Pose submap_from_odom = submap_.odom_from_submap.inverse();
  submap_.travelled_m -= path_m(submap_.scans);
  std::vector<Pose> moves;  // of points, scan by scan, from where the submap had them
  for (std::size_t i = 0; i < odom_from_sensor.size(); ++i) {
    Pose& pose = submap_.scans[i].submap_from_sensor;
    const Pose moved = submap_from_odom * odom_from_sensor[i];
    moves.push_back(moved * pose.inverse());
    pose = moved;
  }
  submap_.travelled_m += path_m(submap_.scans);
  voxels_.clear();
  std::size_t kept = 0;
  for (std::size_t k = 0; k < submap_.points.size(); ++k) {
    const std::int32_t scan = submap_.scan_indices[k];
    const Eigen::Vector3d moved = moves[static_cast<std::size_t>(scan)] * submap_.points[k].cast<double>();
    const Eigen::Vector3f p = moved.cast<float>();
    if (!voxels_.insert(key_of(p, static_cast<float>(inverse_voxel_))).second) continue;
    submap_.points[kept] = p;
    submap_.scan_indices[kept++] = scan;
  }
  submap_.points.resize(kept);
  submap_.scan_indices.resize(kept);
}

std::optional<Submap> SubmapBuilder::finish() {
  if (submap_.scans.empty()) return std::nullopt;
  return cut();
}

Submap SubmapBuilder::cut() {
  Submap done = std::move(submap_);
  submap_ = Submap();
  submap_.id = done.id + 1;
  submap_.odom_from_submap = last_odom_from_sensor_;
  submap_.points.reserve(done.points.size());
  submap_.scan_indices.reserve(done.points.size());
  voxels_.clear();
  return done;
}

void SubmapBuilder::save(ByteWriter& out) const {
  out.put(submap_.id);
  out.put(submap_.odom_from_submap);
  out.put(last_odom_from_sensor_);
}

void SubmapBuilder::load(ByteReader& in) {
  submap_ = Submap();
  voxels_.clear();
  submap_.id = in.take<std::int64_t>();
  submap_.odom_from_submap = in.take<Pose>();
  last_odom_from_sensor_ = in.take<Pose>();
}

}  // namespace hp2
