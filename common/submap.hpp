// A finished submap: what the front-end hands to the back-end, and what the back-end stores.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// How far a registered pose can be trusted.
enum class TrackingState : std::uint8_t {
  kTracking = 0,    ///< All six directions are observed.
  kDegenerate = 1,  ///< Some direction is not observed; the prediction was kept there.
  kLost = 2,        ///< The scan did not fit the map; the pose is the prediction.
};

/// What the registration of one scan saw and took; for reports.
struct ScanDiagnostics {
  float alpha = 0.0F;                 ///< |P| / (|P| + |Q|); 0 without correspondences.
  float sigma = 0.0F;                 ///< Scale of the robust loss [m].
  float min_eigenvalue_ratio = 0.0F;  ///< Of the information matrix, 0..1; near 0 is degenerate.
  int iterations = 0;
  /// Milliseconds a stage: preprocess, neighbour search, planarity, solve, map update, total.
  std::array<float, 6> ms{};
};

/// One scan of a submap.
struct ScanPose {
  std::int64_t sequence = 0;               ///< Scan's number in the stream.
  std::int64_t utime = 0;                  ///< End of the sweep [us].
  Pose submap_from_sensor;                 ///< Pose at the end of the sweep.
  Matrix6d covariance = Matrix6d::Zero();  ///< Of the motion since the previous scan, (rho [m], phi [rad]),
                                           ///< right increments in this scan's sensor frame.
  TrackingState state = TrackingState::kTracking;  ///< State of its registration.
  ScanDiagnostics diagnostics;
};

/// A part of the local map with its scans. Its frame is the keypose's: the last pose of the submap before
/// (for the first submap that of the first scan: identity unless the first scans were re-estimated).
struct Submap {
  std::int64_t id = 0;                     ///< 0, 1, 2, ... in one session.
  Pose odom_from_submap;                   ///< Keypose in the drifting odometry frame.
  std::vector<Eigen::Vector3f> points;     ///< [m], submap frame, downsampled.
  std::vector<Eigen::Vector3f> normals;    ///< One per point, of unit length (to 1/127); zero: not planar.
  std::vector<std::int32_t> scan_indices;  ///< One per point: index into `scans` of the scan that saw it.
  std::vector<ScanPose> scans;             ///< In order of time.
  double travelled_m = 0.0;                ///< Path length inside this submap.
  std::int64_t scans_skipped = 0;  ///< Scans of the stream in this submap's span that were not registered.
};

}  // namespace hp2
