// A session made from exact ground truth: an odometry that drifts by a known rate, final poses that are exact
// but for a known offset, submaps, closures and diagnostics. What a real run would leave, with known answers.
#pragma once
#include <cmath>
#include <functional>
#include <memory>
#include <random>
#include <vector>

#include "backend/graph/derived.hpp"
#include "viewer_headless/session_view.hpp"

namespace hp2::testing {

/// Points that the scan with that number sees, in its sensor frame [m].
using ScanPoints = std::function<std::vector<Eigen::Vector3f>(std::size_t)>;

struct MadeUpOptions {
  std::size_t scans_a_submap = 100;
  double yaw_drift_rad_m = 2e-4;  ///< Odometry's false turn for every metre.
  double scale = 1.004;           ///< Odometry's false scale.
  double voxel_m = 0.5;           ///< Of the submaps' points; 0: all.
  double revisit_m = 15.0;        ///< Keyposes nearer than this, 4 submaps apart or more, are closed.
};

struct MadeUpSession {
  SessionView view;
  std::vector<Pose> truth;  ///< map_from_sensor
};

/// @param truth poses from identity on; the ground truth in the view lies in a frame moved by world_from_map
inline MadeUpSession make_session(const std::vector<Pose>& truth, const ScanPoints& points,
                                  const MadeUpOptions& options = {}, const Pose& world_from_map = Pose()) {
  MadeUpSession out;
  out.truth = truth;
  SessionView& view = out.view;
  view.session_id = 7312344556677889;
  std::vector<Pose> odom{truth.front()};
  for (std::size_t i = 1; i < truth.size(); ++i) {
    Pose step = truth[i - 1].inverse() * truth[i];
    const double length = step.translation.norm();
    step.translation *= options.scale;
    odom.push_back(odom.back() * step * Pose(so3_exp({0, 0, options.yaw_drift_rad_m * length}), {0, 0, 0}));
  }
  struct Range {
    std::size_t first, last;
    Pose odom_from_submap, map_from_submap;
  };
  auto ranges = std::make_shared<std::vector<Range>>();
  for (std::size_t first = 0; first < truth.size(); first += options.scans_a_submap) {
    const std::size_t before = first == 0 ? 0 : first - 1;
    ranges->push_back({first, std::min(first + options.scans_a_submap, truth.size()),
                       first == 0 ? Pose() : odom[before], first == 0 ? Pose() : truth[before]});
  }
  view.submap_count = static_cast<std::int64_t>(ranges->size());
  view.graph.revision = 5;
  view.graph.ended = true;
  for (std::size_t k = 0; k < ranges->size(); ++k) {
    const Range& r = (*ranges)[k];
    view.graph.map_from_submap.push_back(r.map_from_submap);
    for (std::size_t i = r.first; i < r.last; ++i) {
      view.graph.trajectory.push_back({static_cast<std::int64_t>(i),
                                       1700000000000000 + 100000 * std::int64_t(i + 1),
                                       static_cast<std::int64_t>(k), odom[i], truth[i]});
      view.ground_truth.push_back(world_from_map * truth[i]);
    }
    for (std::size_t j = 0; j + 4 <= k; ++j) {
      ClosureRecord c;
      c.from_submap = static_cast<std::int64_t>(j);
      c.to_submap = static_cast<std::int64_t>(k);
      c.from_from_to = (*ranges)[j].map_from_submap.inverse() * r.map_from_submap;
      if (c.from_from_to.translation.norm() > 3 * options.revisit_m) continue;
      c.accepted = c.from_from_to.translation.norm() < options.revisit_m;
      c.inliers = c.accepted ? 12 : 4;
      c.overlap = c.accepted ? 0.71 : -1;
      c.residual_m = c.accepted ? 0.06 : -1;
      c.reason = c.accepted ? "" : "too few inliers, 4 of 5";
      c.information = c.accepted ? Matrix6d(100.0 * Matrix6d::Identity()) : Matrix6d::Zero();
      view.graph.closures.push_back(c);
    }
  }
  view.read_submap = [ranges, odom, points, options](std::int64_t id) {
    const Range& r = ranges->at(static_cast<std::size_t>(id));
    Submap submap;
    submap.id = id;
    submap.odom_from_submap = r.odom_from_submap;
    std::mt19937 rng(static_cast<unsigned>(id));
    std::normal_distribution<float> normal;
    for (std::size_t i = r.first; i < r.last; ++i) {
      ScanPose scan;
      scan.sequence = static_cast<std::int64_t>(i);
      scan.utime = 1700000000000000 + 100000 * std::int64_t(i + 1);
      scan.submap_from_sensor = r.odom_from_submap.inverse() * odom[i];
      scan.covariance = 1e-4 * Matrix6d::Identity();
      const float t = static_cast<float>(i);
      scan.diagnostics.alpha = 0.6F + 0.2F * std::sin(t / 60) + 0.02F * normal(rng);
      scan.diagnostics.sigma = 0.3F + 0.1F * std::cos(t / 45);
      scan.diagnostics.min_eigenvalue_ratio = std::exp(-2.5F + std::sin(t / 80) + 0.1F * normal(rng));
      if (i % 400 > 370) {
        scan.state = i % 400 > 390 ? TrackingState::kLost : TrackingState::kDegenerate;
        scan.diagnostics.min_eigenvalue_ratio *= 0.01F;
      }
      scan.diagnostics.iterations = 8;
      scan.diagnostics.ms = {1.2F, 2.6F, 0.8F, 0.9F, 1.1F, 6.6F};
      for (float& ms : scan.diagnostics.ms) ms *= 1.0F + 0.15F * std::abs(normal(rng));
      for (const Eigen::Vector3f& p : points(i)) {
        submap.points.push_back((scan.submap_from_sensor * p.cast<double>()).cast<float>());
        submap.normals.emplace_back(0.0F, 0.0F, 0.0F);
        submap.scan_indices.push_back(static_cast<std::int32_t>(submap.scans.size()));
      }
      submap.scans.push_back(scan);
    }
    return submap;
  };
  std::vector<Submap> submaps;
  for (std::int64_t id = 0; id < view.submap_count; ++id) submaps.push_back(view.read_submap(id));
  view.graph.odometry = odometry_edges(submaps);
  view.scans_in = static_cast<std::int64_t>(truth.size());
  view.elapsed_s = 0.0125 * static_cast<double>(truth.size());
  view.meta = {{"data", "made-up"},
               {"sensor", "os1-64"},
               {"format", "generic"},
               {"version", "0.1.0"},
               {"configuration", "frontend:\n  mode: hybrid\n  voxel_size_m: 0.6\n"}};
  for (const char* name : {"hp2_player", "hp2_frontend", "hp2_backend"}) {
    view.processes[name] = {{"version", "0.1.0"},
                            {"host", "bench"},
                            {"pid", 4711},
                            {"peak_memory_mb", 123.4},
                            {"state", "finished"},
                            {"text", "done"},
                            {"counters", {{"chunks_sent", 1200}, {"chunks_resent", 3}}}};
  }
  return out;
}

/// A closed drive around a block of side `side` [m], 1 m a scan, with rounded corners, `laps` times.
inline std::vector<Pose> block_drive(double side, double laps) {
  std::vector<Pose> poses;
  const double perimeter = 4 * side;
  const double radius = 0.1 * side;
  // Yaw rate: a quarter turn spread over the arc at the end of every side.
  Pose pose;
  for (double s = 0; s <= laps * perimeter; s += 1.0) {
    poses.push_back(pose);
    const bool turning = std::fmod(s, side) >= side - radius;
    const double yaw = turning ? 0.5 * M_PI / std::ceil(radius) : 0.0;
    pose = pose * Pose(so3_exp({0, 0, yaw}), {1, 0, 0});
  }
  return poses;
}

}  // namespace hp2::testing
