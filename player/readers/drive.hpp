// A drive whose scans are one file each, as made by every reader of such a data set, and the ScanSource
// around it.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "player/scan_source.hpp"

namespace hp2 {

/// One scan of a drive, before it is read.
struct DriveScan {
  std::string path;              ///< File, or whatever Drive::decode needs to find it.
  std::int64_t utime = 0;        ///< Start of the sweep [us].
  std::int64_t duration_us = 0;  ///< 0: no time in the sweep.
  std::int64_t key = 0;          ///< Anything else that Drive::decode needs.

  std::int64_t utime_end() const { return utime + duration_us; }
};

/// A drive as found, all its scans in order.
struct Drive {
  SourceInfo info;
  std::vector<DriveScan> scans;
  /// World-from-sensor at each scan's utime_end(); empty, or as many entries as scans, some of them without a
  /// pose.
  std::vector<std::optional<Pose>> ground_truth;
  std::vector<std::string> warnings;
  std::string time_in_sweep;  ///< Unit of the points' times, for people; "": the points have none.
  /// Instant of the sweep that DriveScan::utime marks where duration_us is 0: 0 start, 0.5 middle, 1 end.
  double stamp_in_sweep = 0.0;
  /// False where the format defines how the points lie in the sweep: the scans are not examined
  /// (settle_sweep()).
  bool sweep_in_doubt = true;
  std::string sweep = "given";  ///< See ScanSource::sweep().
  /// Replaces the points, which may be those of an older scan, and sets the times in the sweep, if there are
  /// any, which are empty; everything else of the scan is set already. Called from several threads.
  std::function<void(const DriveScan&, Scan&)> decode;
};

/// The drive with first, count and stride of `options` applied.
/// @throws Error if no scan is left
std::unique_ptr<ScanSource> make_source(Drive drive, const SourceOptions& options);

// One reader each; see README.md. All throw Error if the drive is not there or has no scan.
Drive open_folder_drive(const std::string& folder, bool kitti, const SourceOptions& options);
Drive open_kitti_raw(const std::string& folder);
Drive open_mulran(const std::string& folder);
Drive open_helipr(const std::string& folder, const SourceOptions& options);
Drive open_apollo(const std::string& folder);
Drive open_lcm_log(const std::string& file, const SourceOptions& options);
Drive open_packet_capture(const std::string& file, const SourceOptions& options);
/// A bag of ROS 1 ("rosbag") or ROS 2 ("rosbag2"), or a folder of its parts; see bags/.
Drive open_bag(const std::string& path, const std::string& format, const SourceOptions& options);

}  // namespace hp2
