#include "viewer_headless/session_digest.hpp"

#include <algorithm>

namespace hp2 {

namespace {

const TrajectoryPose* find(const std::vector<TrajectoryPose>& trajectory, std::int64_t sequence) {
  const auto it = std::lower_bound(trajectory.begin(), trajectory.end(), sequence,
                                   [](const TrajectoryPose& p, std::int64_t s) { return p.sequence < s; });
  return it != trajectory.end() && it->sequence == sequence ? &*it : nullptr;
}

void hand_on_points(const Submap& submap, const Pose& map_from_submap,
                    const std::vector<Pose>& map_from_sensor, const PointSink& sink) {
  std::vector<Pose> corrected;
  for (std::size_t i = 0; i < submap.scans.size(); ++i) {
    corrected.push_back(map_from_sensor[i] * submap.scans[i].submap_from_sensor.inverse());
  }
  for (std::size_t i = 0; i < submap.points.size(); ++i) {
    const std::int32_t scan = i < submap.scan_indices.size() ? submap.scan_indices[i] : -1;
    const bool known = scan >= 0 && static_cast<std::size_t>(scan) < corrected.size();
    const Eigen::Vector3d point =
        (known ? corrected[scan] : map_from_submap) * submap.points[i].cast<double>();
    if (point.allFinite()) sink(point);
  }
}

}  // namespace

bool SessionDigest::has_times() const {
  for (std::size_t i = 1; i < scans.size(); ++i) {
    if (scans[i].utime <= scans[i - 1].utime) return false;
  }
  return true;
}

std::vector<double> SessionDigest::times_s() const {
  const bool known = has_times();
  std::vector<double> out;
  for (const ScanRecord& scan : scans) {
    out.push_back(known ? 1e-6 * static_cast<double>(scan.utime - scans.front().utime)
                        : static_cast<double>(scan.sequence));
  }
  return out;
}

SessionDigest digest_session(const SessionView& view, const PointSink& sink) {
  SessionDigest digest;
  digest.odometry = view.graph.odometry;
  std::vector<TrajectoryPose> trajectory = view.graph.trajectory;
  const auto by_sequence = [](const auto& a, const auto& b) { return a.sequence < b.sequence; };
  std::stable_sort(trajectory.begin(), trajectory.end(), by_sequence);

  Pose start_from_odom;  // the odometry's trajectory begins where the map does
  for (std::int64_t id = 0; id < view.submap_count; ++id) {
    const Submap submap = view.read_submap(id);
    const auto index = static_cast<std::size_t>(id);
    if (id == 0) start_from_odom = submap.odom_from_submap.inverse();
    const Pose map_from_submap = index < view.graph.map_from_submap.size()
                                     ? view.graph.map_from_submap[index]
                                     : view.graph.map_from_odom * submap.odom_from_submap;
    std::vector<Pose> map_from_sensor;
    for (const ScanPose& scan : submap.scans) {
      const TrajectoryPose* final_pose = find(trajectory, scan.sequence);
      ScanRecord record;
      record.sequence = scan.sequence;
      record.utime = scan.utime;
      record.submap = submap.id;
      record.odom_from_sensor = start_from_odom * submap.odom_from_submap * scan.submap_from_sensor;
      record.map_from_sensor =
          final_pose != nullptr ? final_pose->map_from_sensor : map_from_submap * scan.submap_from_sensor;
      record.state = scan.state;
      record.diagnostics = scan.diagnostics;
      map_from_sensor.push_back(record.map_from_sensor);
      digest.scans.push_back(record);
    }
    if (sink) hand_on_points(submap, map_from_submap, map_from_sensor, sink);
    digest.map_from_submap.push_back(map_from_submap);
    digest.scans_skipped += submap.scans_skipped;
  }
  // Scans of the trajectory that are in no readable submap still have a pose to write; unique() keeps the
  // first of two, which after the stable sort is the submap's, with its diagnostics.
  for (const TrajectoryPose& pose : trajectory) {
    digest.scans.push_back({pose.sequence,
                            pose.utime,
                            pose.submap,
                            start_from_odom * pose.odom_from_sensor,
                            pose.map_from_sensor,
                            TrackingState::kTracking,
                            {}});
  }
  std::stable_sort(digest.scans.begin(), digest.scans.end(), by_sequence);
  const auto same = [](const auto& a, const auto& b) { return a.sequence == b.sequence; };
  digest.scans.erase(std::unique(digest.scans.begin(), digest.scans.end(), same), digest.scans.end());

  for (std::size_t i = 1; i < digest.scans.size(); ++i) {
    digest.path_m +=
        (digest.scans[i].map_from_sensor.translation - digest.scans[i - 1].map_from_sensor.translation)
            .norm();
  }
  if (!digest.scans.empty() && digest.has_times()) {
    digest.duration_s = 1e-6 * static_cast<double>(digest.scans.back().utime - digest.scans.front().utime);
  }
  return digest;
}

std::vector<std::size_t> SessionDigest::gaps() const {
  std::vector<std::size_t> before;
  if (!has_times() || scans.size() < 3) return before;
  std::vector<std::int64_t> steps;
  for (std::size_t i = 1; i < scans.size(); ++i) steps.push_back(scans[i].utime - scans[i - 1].utime);
  std::vector<std::int64_t> sorted = steps;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const std::int64_t longest = std::max<std::int64_t>(1'000'000, 5 * *middle / 2);
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] > longest) before.push_back(i + 1);
  }
  return before;
}

}  // namespace hp2
