// One pass over the session's submaps: every scan with its final pose and diagnostics, the odometry between
// keyposes, and the map's points handed on one by one.
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "viewer_headless/session_view.hpp"

namespace hp2 {

/// One scan as the outputs need it.
struct ScanRecord {
  std::int64_t sequence = 0;
  std::int64_t utime = 0;  ///< End of the sweep [us].
  std::int64_t submap = 0;
  Pose odom_from_sensor;  ///< Before any correction.
  Pose map_from_sensor;   ///< Final.
  TrackingState state = TrackingState::kTracking;
  ScanDiagnostics diagnostics;
};

/// What is left of a session without its points.
struct SessionDigest {
  std::vector<ScanRecord> scans;      ///< In order of sequence, each once.
  std::vector<Pose> map_from_submap;  ///< One per submap, also of those that the graph does not have yet.
  std::vector<GraphEdge> odometry;    ///< Between consecutive keyposes, as the back-end weighs it.
  std::int64_t scans_skipped = 0;     ///< By overload or gaps, as the front-end counted.
  double path_m = 0.0;                ///< Length of the final trajectory [m].
  double duration_s = 0.0;            ///< From the first to the last scan by their stamps [s].

  /// Seconds of every scan since the first one; scan numbers if the stamps do not rise.
  std::vector<double> times_s() const;
  bool has_times() const;
  /// Indices of the scans before which others are missing, for longer than a second: no line is drawn across.
  std::vector<std::size_t> gaps() const;
};

/// A point of the map in the map frame [m].
using PointSink = std::function<void(const Eigen::Vector3d&)>;

/// Reads every submap once, in order of id. Each point goes to `sink` (if there is one) where the corrected
/// pose of the scan that saw it puts it: map_from_sensor * submap_from_sensor^-1 * point.
SessionDigest digest_session(const SessionView& view, const PointSink& sink);

}  // namespace hp2
