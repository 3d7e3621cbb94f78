// What the calibration works on: stretches of a drive, each a few thinned scans with the poses that odometry
// gave them.
#pragma once
#include <cstdint>
#include <optional>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"
#include "common/scan.hpp"
#include "common/sensor.hpp"

namespace hp2 {

/// A point as the sensor gave it.
struct CalibrationPoint {
  Eigen::Vector3f position;  ///< Sensor frame at the firing instant [m].
  float time = 1.0F;         ///< In the sweep; 1 where it is not known.
  std::int16_t ring = 0;
};

/// A thinned scan.
struct CalibrationScan {
  Pose map_from_sensor;                     ///< At the sweep's end; an estimate that calibration refines.
  Vector6d sweep_twist = Vector6d::Zero();  ///< Log(motion of the sensor from start to end of the sweep).
  std::vector<CalibrationPoint> points;
};

/// Scans that see the same surfaces from places apart.
using CalibrationWindow = std::vector<CalibrationScan>;

/// How windows are cut.
struct WindowConfig {
  std::size_t scans_per_window = 24;
  std::size_t points_per_scan = 4000;
  double spacing_m = 1.0;    ///< Travel from scan to scan of a window.
  double spacing_rad = 0.2;  ///< Or turn.
  double min_range_m = 1.0;
  double max_range_m = 60.0;
};

/// Gathers windows from a stream of scans and their odometry.
class WindowCutter {
 public:
  /// @param rings vertical angle of each ring [deg]; empty: all points are of one ring, number 0
  WindowCutter(const WindowConfig& config, const std::vector<double>& rings);
  /// @param odom_from_sensor at the sweep's end
  /// @return a window that this scan completes
  std::optional<CalibrationWindow> add(const Scan& scan, const Pose& odom_from_sensor);

 private:
  std::vector<CalibrationPoint> thinned(const Scan& scan) const;

  WindowConfig config_;
  bool one_ring_;
  RingTable table_;
  std::optional<Pose> last_pose_, last_taken_;
  std::int64_t last_utime_ = 0;
  CalibrationWindow window_;
};

}  // namespace hp2
