#include "viewer_headless/pose_files.hpp"

#include <cstdio>

#include "common/evaluation/score_table.hpp"
#include "common/evaluation/trajectory.hpp"

namespace hp2 {

namespace {

Trajectory trajectory_of(const SessionDigest& digest, Pose ScanRecord::*pose) {
  std::vector<Pose> poses;
  for (const auto& scan : digest.scans) poses.push_back(scan.*pose);
  Trajectory out = make_trajectory(poses);
  for (const auto& scan : digest.scans) out.times_s.push_back(1e-6 * static_cast<double>(scan.utime));
  return out;
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.12g", value);
  return text;
}

std::string quaternion_pose(const Pose& pose, char separator) {
  std::string out;
  for (int k = 0; k < 3; ++k) out += number(pose.translation[k]) + separator;
  for (int k = 0; k < 4; ++k)
    out += number(pose.rotation.coeffs()[k]) + (k < 3 ? std::string(1, separator) : "");
  return out;
}

// g2o's error of an edge is measurement^-1 from^-1 to as (t, vector part of the quaternion): right increments
// in the frame of `to`, as ours are, but with half the rotation vector.
std::string edge(std::size_t from, std::size_t to, const Pose& pose, Matrix6d information) {
  information.rightCols<3>() *= 2.0;
  information.bottomRows<3>() *= 2.0;
  std::string out =
      "EDGE_SE3:QUAT " + std::to_string(from) + " " + std::to_string(to) + " " + quaternion_pose(pose, ' ');
  for (int r = 0; r < 6; ++r) {
    for (int c = r; c < 6; ++c) out += " " + number(information(r, c));
  }
  return out + "\n";
}

}  // namespace

std::string poses_kitti(const SessionDigest& digest) {
  return format_trajectory(trajectory_of(digest, &ScanRecord::map_from_sensor), TrajectoryFormat::kKitti);
}

std::string poses_tum(const SessionDigest& digest) {
  return format_trajectory(trajectory_of(digest, &ScanRecord::map_from_sensor), TrajectoryFormat::kTum);
}

std::string poses_odometry_kitti(const SessionDigest& digest) {
  return format_trajectory(trajectory_of(digest, &ScanRecord::odom_from_sensor), TrajectoryFormat::kKitti);
}

std::string poses_odometry_tum(const SessionDigest& digest) {
  return format_trajectory(trajectory_of(digest, &ScanRecord::odom_from_sensor), TrajectoryFormat::kTum);
}

std::string graph_g2o(const SessionDigest& digest, const std::vector<ClosureRecord>& closures) {
  std::string out;
  const std::size_t n = digest.map_from_submap.size();
  for (std::size_t i = 0; i < n; ++i) {
    out +=
        "VERTEX_SE3:QUAT " + std::to_string(i) + " " + quaternion_pose(digest.map_from_submap[i], ' ') + "\n";
  }
  if (n > 0) out += "FIX 0\n";
  for (std::size_t i = 0; i < digest.odometry.size(); ++i) {
    out += edge(i, i + 1, digest.odometry[i].from_from_to, digest.odometry[i].information);
  }
  for (const ClosureRecord& c : closures) {
    const auto from = static_cast<std::size_t>(c.from_submap), to = static_cast<std::size_t>(c.to_submap);
    if (!c.accepted || c.from_submap < 0 || c.to_submap < 0 || from >= n || to >= n) continue;
    out += edge(from, to, c.from_from_to, c.information);
  }
  return out;
}

std::string closures_csv(const std::vector<ClosureRecord>& closures) {
  Table table{{"from_submap", "to_submap", "inliers", "overlap", "residual_m", "accepted", "reason", "tx",
               "ty", "tz", "qx", "qy", "qz", "qw"}};
  for (const ClosureRecord& c : closures) {
    std::vector<std::string> row{std::to_string(c.from_submap),
                                 std::to_string(c.to_submap),
                                 std::to_string(c.inliers),
                                 c.overlap < 0 ? "" : number(c.overlap),
                                 c.residual_m < 0 ? "" : number(c.residual_m),
                                 c.accepted ? "true" : "false",
                                 c.reason};
    for (int k = 0; k < 3; ++k) row.push_back(number(c.from_from_to.translation[k]));
    for (int k = 0; k < 4; ++k) row.push_back(number(c.from_from_to.rotation.coeffs()[k]));
    table.push_back(row);
  }
  return format_csv(table);
}

}  // namespace hp2
