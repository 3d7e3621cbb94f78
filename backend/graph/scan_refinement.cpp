#include "backend/graph/scan_refinement.hpp"

#include <algorithm>

#include <Eigen/Cholesky>

#include "backend/graph/odometry_noise.hpp"
#include "backend/graph/pieces.hpp"

namespace hp2 {
namespace {

constexpr int kMaxIterations = 10;
constexpr double kConverged = 1e-10;

}  // namespace

std::vector<Pose> refine_scans(const std::vector<ScanPose>& scans, const Pose& map_from_submap,
                               const Pose* map_from_next) {
  const std::size_t n = scans.size();
  std::vector<Pose> poses(n);
  for (std::size_t i = 0; i < n; ++i) poses[i] = map_from_submap * scans[i].submap_from_sensor;
  if (n == 0 || map_from_next == nullptr) return poses;

  // Minimise sum x_i^T C_i^-1 x_i over the corrections x_i of the steps, subject to the chain of Z_i Exp(x_i)
  // ending at the next keypose. To first order the end moves by sum A_i x_i, with A_i the adjoint of the
  // transform from the end to scan i. Hence x_i = C_i A_i^T (sum A_j C_j A_j^T)^-1 e: each step takes its
  // share of the gap e. Repeated with the chain corrected so far, as the composition is not linear.
  const std::vector<OdometryStep> steps = odometry_steps(scans);
  std::vector<Vector6d> x(n, Vector6d::Zero());
  std::vector<Matrix6d> shares(n);
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Vector6d gap = se3_log(poses[n - 1].inverse() * *map_from_next);
    if (gap.norm() < kConverged) break;
    Matrix6d sum = Matrix6d::Zero();
    Vector6d linear = gap;
    for (std::size_t i = 0; i < n; ++i) {
      const Matrix6d a = adjoint(poses[n - 1].inverse() * poses[i]);
      shares[i] = steps[i].covariance * a.transpose();
      sum += a * shares[i];
      linear += a * x[i];  // the gap that x = 0 would leave, in this linearisation
    }
    const Vector6d multiplier = sum.ldlt().solve(linear);
    Pose pose = map_from_submap;
    for (std::size_t i = 0; i < n; ++i) {
      x[i] = shares[i] * multiplier;
      pose = pose * steps[i].previous_from_current * se3_exp(x[i]);
      poses[i] = pose;
    }
  }
  poses[n - 1] = *map_from_next;
  return poses;
}

void append_trajectory(const Submap& submap, const Submap* next, const std::vector<Pose>& map_from_submap,
                       std::vector<TrajectoryPose>& trajectory) {
  const auto k = static_cast<std::size_t>(submap.id);
  const Pose& keypose = map_from_submap.at(k);
  const std::vector<ScanPose>& scans = submap.scans;
  const AnchoredScans anchored = anchored_scans(scans);
  const bool ends_at_next =
      next != nullptr && k + 1 < map_from_submap.size() && !anchored_scans(next->scans).starts_piece;
  const Pose* map_from_next = ends_at_next ? &map_from_submap[k + 1] : nullptr;
  std::vector<Pose> poses;
  if (anchored.starts_piece) {
    // Scans before the loss continue from the end of the submap before.
    const bool follows = !trajectory.empty() && trajectory.back().submap == submap.id - 1;
    const Pose before = follows ? trajectory.back().map_from_sensor : keypose;
    for (std::size_t i = 0; i < anchored.begin; ++i) poses.push_back(before * scans[i].submap_from_sensor);
    const Pose first = keypose * scans[anchored.begin].submap_from_sensor;
    poses.push_back(first);
    std::vector<ScanPose> rest(scans.begin() + static_cast<std::ptrdiff_t>(anchored.begin + 1), scans.end());
    for (ScanPose& s : rest) {
      s.submap_from_sensor = scans[anchored.begin].submap_from_sensor.inverse() * s.submap_from_sensor;
    }
    const std::vector<Pose> after = refine_scans(rest, first, map_from_next);
    poses.insert(poses.end(), after.begin(), after.end());
  } else if (anchored.ends_piece && map_from_next != nullptr) {
    // Scans after the loss lead to the next keypose.
    const auto last = std::find_if(scans.rbegin(), scans.rend(),
                                   [](const ScanPose& s) { return s.state == TrackingState::kLost; })
                          .base() -
                      1;
    const Pose end = *map_from_next * scans.back().submap_from_sensor.inverse();
    for (auto s = scans.begin(); s != scans.end(); ++s) {
      poses.push_back((s < last ? keypose : end) * s->submap_from_sensor);
    }
  } else {
    poses = refine_scans(scans, keypose, map_from_next);
  }
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const ScanPose& scan = scans[i];
    trajectory.push_back(
        {scan.sequence, scan.utime, submap.id, submap.odom_from_submap * scan.submap_from_sensor, poses[i]});
  }
}

}  // namespace hp2
