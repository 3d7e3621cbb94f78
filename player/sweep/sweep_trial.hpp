// Registers a stretch of scans under one reading of their times and says how well they agree.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"
#include "common/scan.hpp"
#include "player/sweep/sweep_reading.hpp"

namespace hp2 {

/// The points of a scan that a trial needs.
struct TrialScan {
  std::vector<Eigen::Vector3f> points;  ///< Sensor frame at the firing instant [m], one per voxel.
  std::vector<float> azimuth_rad;       ///< One per point.
  std::vector<float> given;             ///< Time in the sweep, one per point; empty: absent.
  std::vector<std::uint32_t> source;    ///< Of these, the ones that are registered.
  double utime_s = 0.0;                 ///< Of the scan, whatever instant it marks.
};

/// How large what a scan sees is: 1 for a street, down to 0.25 for a narrow corridor.
double scale_of_scene(const Scan& scan);

/// Thins a scan out.
TrialScan make_trial_scan(const Scan& scan, double scale);

/// What came of one reading.
struct TrialResult {
  std::vector<double>
      costs;                ///< A scan after the first: mean robust residual of its points to the map, 0..1.
  std::vector<Pose> poses;  ///< World-from-sensor at the instant that the reading makes the scan refer to.
  double travelled_m = 0.0;
  double turned_rad = 0.0;
};

/// Registers the scans one after the other to the map of those before.
/// @param gain      share of the motion within the sweep that is undone; 1: all, 0: none
/// @param sweep_s   duration of a sweep [s]
/// @param scale     of the scene
/// @param before    an earlier result that gives the motions to begin with; nullptr: none
TrialResult try_reading(const std::vector<TrialScan>& scans, const SweepReading& reading, double gain,
                        double sweep_s, double scale, const TrialResult* before);

}  // namespace hp2
