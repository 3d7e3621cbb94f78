// Where scans come from: the one interface that every data set's reader implements.
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/pose.hpp"
#include "common/scan.hpp"
#include "common/sensor.hpp"

namespace hp2 {

/// A ground-truth pose and the instant it holds for.
struct StampedPose {
  std::int64_t utime = 0;  ///< [us], same clock as the scans'.
  Pose pose;               ///< world_from_sensor, in the LiDAR's frame (x forward, y left, z up).
};

/// What is known of a drive without reading its scans.
struct SourceInfo {
  std::string name;    ///< e.g. "kitti_0926_0001" or "synthetic:loop:1".
  std::string format;  ///< "kitti", "kitti-raw", "mulran", "helipr", "apollo", "generic", "synthetic",
                       ///< "lcm-log", "rosbag", "rosbag2", "pcap".
  std::string sensor;  ///< e.g. "hdl64"; "" if not known.
  std::string path;    ///< Folder or file; "" for a synthetic drive.
};

/// A logged or synthetic drive with random access to its scans.
class ScanSource {
 public:
  virtual ~ScanSource() = default;
  virtual const SourceInfo& info() const = 0;
  /// Number of scans after first, count and stride were applied.
  virtual std::size_t size() const = 0;
  /// Reads scan `index` in [0, size()). Its `sequence` is `index`; its `utime` is the START of the sweep,
  /// whatever instant the data set stamps. `time` is empty and `duration_us` 0 where the data has no time in
  /// the sweep. Thread-safe: several threads may read different scans at once.
  /// @param used_up a scan that is no longer needed: its memory may be used again
  /// @throws Error if the file cannot be read, is truncated, or its header gives a wrong size
  virtual Scan read(std::size_t index, Scan used_up) const = 0;
  Scan read(std::size_t index) const { return read(index, {}); }
  /// End of the sweep of scan `index` [us] as far as it is known without reading the scan; for real-time
  /// pacing.
  virtual std::optional<std::int64_t> utime_end(std::size_t index) const {
    (void)index;
    return std::nullopt;
  }
  /// Ground truth in the LiDAR's frame, one per scan, at the END of each sweep where the data set knows it
  /// and at the scan's stamp otherwise; empty if there is none.
  virtual const std::vector<StampedPose>& ground_truth() const = 0;
  /// Remarks of the reader for the user, e.g. "times.txt is not monotonic: assuming 10
  /// Hz".
  virtual std::vector<std::string> warnings() const { return {}; }
  /// Unit of the points' times, for people; "": they have none, or it is not known.
  virtual std::string time_in_sweep() const { return {}; }
  /// How the points lie in the sweep, in the words of SourceOptions::sweep: what was found or chosen, "given"
  /// where nothing was done.
  virtual std::string sweep() const { return "given"; }
  /// With SourceOptions::skip_damaged: what is wrong with the scans that could not be read until now, one
  /// sentence per scan.
  virtual std::vector<std::string> damaged() const { return {}; }
};

/// Which scans to take and how to read them.
struct SourceOptions {
  std::string dataset;        ///< Format by name; empty: recognise it from the folder.
  std::size_t first = 0;      ///< Skip so many scans.
  std::size_t count = 0;      ///< Take at most so many; 0: all.
  std::size_t stride = 1;     ///< Take every stride-th.
  std::string times_unit;     ///< Unit of the scans' times in a file: "s", "ms", "us", "ns"; empty: find it.
  std::string points_unit;    ///< Unit of the points: "m", "cm", "mm"; empty: find it.
  bool skip_damaged = false;  ///< A scan that cannot be read is an empty one; see ScanSource::damaged().
  /// Vertical angles raised by 0.205 degrees: 1 yes, 0 no, -1 if the scans are KITTI's.
  int kitti_correction = -1;
  /// How the points lie in the sweep: "auto", "given", or a reading (player/sweep/drive_sweep.hpp).
  std::string sweep = "auto";
  std::string
      topic;  ///< Topic of a bag, channel of a log, sender's address in a capture; empty: the only one.
  std::string bin_layout;  ///< Layout of .bin records, e.g. "xyzi"; empty: recognise it.
  std::string
      metadata;  ///< Ouster's metadata JSON for packets; empty: the recording's own, or the one beside it.
  std::string ground_truth_topic;  ///< Topic of a bag that holds poses; empty: none.
};

/// Where the front-end corrects the scans by `calibration`, the points are taken with the vertical angles
/// that they have, unless `options` ask for more, which is a warning in the log.
void leave_angles_to(const SensorCalibration& calibration, SourceOptions& options);

/// Opens a drive named as on every command line: a folder (or file), or `synthetic:SCENE[:SEED]`.
/// @throws Error if there is nothing at `spec`, its format is not recognised, or it holds no scan
std::unique_ptr<ScanSource> open_source(const std::string& spec, const SourceOptions& options = {});

}  // namespace hp2
