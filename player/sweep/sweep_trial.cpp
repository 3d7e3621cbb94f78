#include "player/sweep/sweep_trial.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>

#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"
#include "common/registration/parallel.hpp"

namespace hp2 {
namespace {

constexpr float kMinRange_m = 1.0F, kMaxRange_m = 80.0F;
// In a scene of scale 1, a street. Indoors all of it is smaller.
constexpr double kMapVoxel_m = 0.8, kSpacing_m = 0.25, kCostScale_m = 0.1, kSigma_m = 0.3;
constexpr float kPointVoxel_m = 0.3F, kSourceVoxel_m = 0.8F;
constexpr std::size_t kMaxSource = 2000;

std::uint64_t key_of(const Eigen::Vector3f& p, float edge) {
  const auto part = [&](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v / edge)) + (1 << 20));
  };
  return part(p.x()) << 42 | part(p.y()) << 21 | part(p.z());
}

// Undoes the motion within the sweep: the points in the sensor's frame at its end.
std::vector<Eigen::Vector3f> undistorted(const std::vector<Eigen::Vector3f>& points,
                                         const std::vector<float>& time, const Vector6d& twist) {
  if (time.empty()) return points;
  constexpr int kNodes = 128;
  std::array<Eigen::Matrix<float, 3, 4>, kNodes + 1> nodes;
  for (int i = 0; i <= kNodes; ++i)
    nodes[static_cast<std::size_t>(i)] =
        se3_exp((static_cast<double>(i) / kNodes - 1.0) * twist).matrix().cast<float>();
  std::vector<Eigen::Vector3f> moved(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float at = std::clamp(time[i], 0.0F, 1.0F) * kNodes;
    const auto node = static_cast<std::size_t>(std::min(at, kNodes - 1.0F));
    const float f = at - static_cast<float>(node);
    const Eigen::Vector3f a = nodes[node].leftCols<3>() * points[i] + nodes[node].col(3);
    const Eigen::Vector3f b = nodes[node + 1].leftCols<3>() * points[i] + nodes[node + 1].col(3);
    moved[i] = a + f * (b - a);
  }
  return moved;
}

std::vector<Eigen::Vector3f> picked(const std::vector<Eigen::Vector3f>& points,
                                    const std::vector<std::uint32_t>& indices) {
  std::vector<Eigen::Vector3f> out;
  out.reserve(indices.size());
  for (const std::uint32_t i : indices) out.push_back(points[i]);
  return out;
}

// Mean of e^2 / (e^2 + c^2), e: distance to the map's surface, or to its nearest point where it has none.
double cost_of(LocalMap& map, const std::vector<Eigen::Vector3f>& points, const Pose& pose, double scale_m) {
  double sum = 0.0;
  std::size_t n = 0;
  for (const Eigen::Vector3f& point : points) {
    const VoxelPoint at = map.locate(pose * point.cast<double>());
    const NearestPoint nearest = map.nearest(at);
    if (nearest.voxel < 0) continue;  // new to the map
    if (map.planarity_stale(nearest.voxel)) map.update_planarity(nearest.voxel);
    const Planarity& plane = map.planarity(nearest.voxel);
    double e = static_cast<double>(nearest.distance_m);
    if (plane.n >= 5.0F &&
        plane.score < adaptive_threshold(static_cast<double>(plane.n), 0.2, 27.0, 0.05, 0.3)) {
      const Moments moments = map.neighbourhood_moments(nearest.voxel);
      const Eigen::Vector3d corner = map.voxel_coordinates(nearest.voxel).cast<double>() * map.voxel_size_m();
      e = std::abs(plane.normal.cast<double>().dot(pose * point.cast<double>() - corner - moments.mean()));
    }
    sum += e * e / (e * e + scale_m * scale_m);
    ++n;
  }
  return n > 0 ? sum / static_cast<double>(n) : 1.0;
}

}  // namespace

double scale_of_scene(const Scan& scan) {
  std::vector<float> ranges;
  for (std::size_t i = 0; i < scan.size(); i += 7) {
    const float r = std::hypot(scan.x[i], scan.y[i], scan.z[i]);
    if (r > kMinRange_m && r < kMaxRange_m) ranges.push_back(r);
  }
  if (ranges.empty()) return 1.0;
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return std::clamp(static_cast<double>(*middle) / 6.0, 0.25, 1.0);
}

TrialScan make_trial_scan(const Scan& scan, double scale) {
  const auto point_voxel = static_cast<float>(scale) * kPointVoxel_m;
  const auto source_voxel = static_cast<float>(scale) * kSourceVoxel_m;
  TrialScan out;
  out.utime_s = 1e-6 * static_cast<double>(scan.utime);
  const bool timed = scan.time.size() == scan.size();
  std::unordered_set<std::uint64_t> seen, seen_coarse;
  seen.reserve(scan.size() / 4);
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3f p(scan.x[i], scan.y[i], scan.z[i]);
    const float range2 = p.squaredNorm();
    if (!(range2 > kMinRange_m * kMinRange_m && range2 < kMaxRange_m * kMaxRange_m)) continue;
    if (!seen.insert(key_of(p, point_voxel)).second) continue;
    if (seen_coarse.insert(key_of(p, source_voxel)).second)
      out.source.push_back(static_cast<std::uint32_t>(out.points.size()));
    out.points.push_back(p);
    out.azimuth_rad.push_back(std::atan2(p.y(), p.x()));
    if (timed) out.given.push_back(scan.time[i]);
  }
  const std::size_t stride = (out.source.size() + kMaxSource - 1) / kMaxSource;
  if (stride > 1) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < out.source.size(); i += stride) out.source[kept++] = out.source[i];
    out.source.resize(kept);
  }
  return out;
}

TrialResult try_reading(const std::vector<TrialScan>& scans, const SweepReading& reading, double gain,
                        double sweep_s, double scale, const TrialResult* before) {
  IcpConfig icp_config;
  icp_config.weak_directions = icp_config.two_sides = icp_config.scan_lines = true;
  icp_config.max_iterations = 20;
  HybridIcp icp(icp_config);
  const Parallel parallel(1);
  LocalMap map(scale * kMapVoxel_m, 5, scale * kSpacing_m);
  TrialResult result;
  Vector6d velocity = Vector6d::Zero();            // twist [1/s]
  const auto motion_before = [&](std::size_t k) {  // from scan k to scan k + 1
    return se3_log(before->poses[k].inverse() * before->poses[k + 1]);
  };
  if (before != nullptr && scans.size() > 1)
    velocity = motion_before(0) / std::max(scans[1].utime_s - scans[0].utime_s, 1e-3);
  Pose pose;
  for (std::size_t k = 0; k < scans.size(); ++k) {
    const TrialScan& scan = scans[k];
    std::vector<float> time;
    if (reading.kind == SweepReading::Kind::kAzimuth && gain != 0.0) {
      time.reserve(scan.azimuth_rad.size());
      for (const float a : scan.azimuth_rad) time.push_back(time_of_azimuth(reading, a));
    } else if (reading.kind == SweepReading::Kind::kGiven || reading.kind == SweepReading::Kind::kReversed) {
      time = scan.given;
      if (reading.kind == SweepReading::Kind::kReversed)
        for (float& t : time) t = 1.0F - t;
    }
    const auto straighten = [&] { return undistorted(scan.points, time, gain * sweep_s * velocity); };
    std::vector<Eigen::Vector3f> points = straighten();
    if (k > 0) {
      const double step_s = std::max(scan.utime_s - scans[k - 1].utime_s, 1e-3);
      const Pose last = pose;
      pose = last * se3_exp(step_s * velocity);
      const double sigma = k < 3 && before == nullptr ? 1.0 : std::max(scale, 0.3) * kSigma_m;
      std::vector<Eigen::Vector3f> source = picked(points, scan.source);
      pose = icp.align(map, source, pose, sigma, parallel).map_from_source;
      for (int pass = 0; pass < 2; ++pass) {
        const Vector6d earlier = velocity;
        velocity = se3_log(last.inverse() * pose) / step_s;
        const Vector6d change = sweep_s * (velocity - earlier);
        if (time.empty() || change.head<3>().norm() + 20.0 * change.tail<3>().norm() < 0.02) break;
        points = straighten();
        source = picked(points, scan.source);
        pose = icp.align_again(map, source, pose, sigma, parallel).map_from_source;
      }
      velocity = se3_log(last.inverse() * pose) / step_s;
      result.costs.push_back(cost_of(map, source, pose, kCostScale_m * scale));
      result.travelled_m += (last.inverse() * pose).translation.norm();
      result.turned_rad += rotation_angle((last.inverse() * pose).rotation);
    }
    map.insert(points, pose, pose.translation);
    map.remove_far(pose.translation, 1.2 * static_cast<double>(kMaxRange_m));
    result.poses.push_back(pose);
  }
  return result;
}

}  // namespace hp2
