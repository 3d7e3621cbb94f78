// The front-end as its process, the benchmark and the tests use it: scans in, poses and submaps out. No LCM
// here.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/scan.hpp"
#include "common/submap.hpp"
#include "frontend/frontend_config.hpp"

namespace hp2 {

/// The estimate of one scan.
struct OdometryResult {
  std::int64_t sequence = 0;
  std::int64_t utime = 0;      ///< End of the sweep [us]: the instant the pose refers to.
  Pose odom_from_sensor;       ///< Frame odom drifts but never jumps, except for up to 16 scans after a loss.
  std::int64_t submap_id = 0;  ///< Open submap that the scan went into.
  Pose submap_from_sensor;
  Matrix6d covariance = Matrix6d::Zero();  ///< As ScanPose::covariance.
  TrackingState state = TrackingState::kTracking;
  int n_planar = 0;            ///< |P|
  int n_non_planar = 0;        ///< |Q|
  int n_points = 0;            ///< Points in the scan as received.
  int n_dropped = 0;           ///< Of these not finite or out of range.
  std::int64_t n_skipped = 0;  ///< Scans missing between the last registered one and this one.
  ScanDiagnostics diagnostics;
};

/// What one scan brings.
struct FrontendOutput {
  OdometryResult odometry;
  /// The submap that this scan finished (the scan is its last), if it did.
  std::optional<Submap> finished_submap;
  /// Earlier scans of the open submap that were re-estimated: the speed of the first scans is known only
  /// after a second or two.
  std::vector<OdometryResult> revised;
};

/// Deskew, downsampling, adaptive hybrid ICP, local map and cutting into submaps. The output is a function of
/// the configuration and the scans alone, bit for bit, whatever the number of threads.
class Frontend {
 public:
  /// @param threads number of threads that registration may use, at least 1
  /// @throws Error for a configuration that contradicts itself
  explicit Frontend(const FrontendConfig& config, int threads = 1);
  ~Frontend();
  Frontend(Frontend&&) noexcept;
  Frontend& operator=(Frontend&&) noexcept;

  /// Registers one scan. Scans are expected in order of time; a scan of no usable points gets the predicted
  /// pose and state kLost. Never throws for bad points or times.
  FrontendOutput process(const Scan& scan);
  /// Cuts the open submap at the end of the session; nothing if it holds no scan.
  std::optional<Submap> finish();

  /// Everything that the next scan's result depends on, right after a submap was cut (process() returned a
  /// finished submap, or nothing was processed yet). Opaque bytes, versioned.
  std::vector<std::uint8_t> save_state() const;
  /// Continues from save_state()'s bytes as if never interrupted: the same poses, bit for bit.
  /// @throws Error for bytes of another version, or damaged ones
  void restore_state(const std::vector<std::uint8_t>& state);

  /// Human-readable, one-off remarks on the input since the last call ("the scans carry no time in the sweep:
  /// no deskew").
  std::vector<std::string> take_warnings();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hp2
