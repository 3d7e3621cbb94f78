#include "player/scan_source.hpp"

#include <algorithm>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/layout.hpp"
#include "player/sweep/drive_shape.hpp"
#include "player/sweep/drive_sweep.hpp"
#include "player/sweep/vertical_angles.hpp"
#include "player/synthetic/synthetic_source.hpp"

namespace hp2 {
namespace {

const std::vector<std::string> kFormats = {"kitti",   "kitti-raw", "mulran", "helipr",  "apollo",
                                           "generic", "lcm-log",   "rosbag", "rosbag2", "pcap"};

Drive open_drive(const std::string& spec, const std::string& format, const SourceOptions& options) {
  if (format == "kitti-raw") return open_kitti_raw(spec);
  if (format == "mulran") return open_mulran(spec);
  if (format == "helipr") return open_helipr(spec, options);
  if (format == "apollo") return open_apollo(spec);
  if (format == "lcm-log") return open_lcm_log(spec, options);
  if (format == "pcap") return open_packet_capture(spec, options);
  if (format == "rosbag" || format == "rosbag2") return open_bag(spec, format, options);
  return open_folder_drive(spec, format == "kitti", options);
}

}  // namespace

void leave_angles_to(const SensorCalibration& calibration, SourceOptions& options) {
  if (!corrects_scans(calibration)) return;
  if (options.kitti_correction < 0) options.kitti_correction = 0;
  if (options.kitti_correction > 0)
    spdlog::warn(
        "the vertical angles are raised by 0.205 degrees (--vertical-correction on), and corrected by the "
        "configuration's section \"sensor\" as well");
}

std::unique_ptr<ScanSource> open_source(const std::string& spec, const SourceOptions& options) {
  if (options.sweep != "auto" && options.sweep != "given") parse_sweep(options.sweep);  // a wrong name throws
  if (spec.rfind("synthetic:", 0) == 0) {
    if (!options.dataset.empty() && options.dataset != "synthetic") {
      throw Error("a synthetic drive has no other format", "--dataset " + options.dataset,
                  "Leave --dataset out, or name the drive's folder.");
    }
    return open_synthetic(spec, options);
  }
  if (!is_folder(spec) && !is_file(spec))
    throw Error("there is no such folder or file", spec,
                "Name a drive's folder (its format is recognised) or synthetic:SCENE[:SEED].");
  std::string format = options.dataset;
  if (format.empty()) format = recognise_format(spec);
  if (format.empty())
    throw Error("this holds no scan in a layout that is known", spec,
                "Give the folder that holds the scans or velodyne/, an LCM log, a ROS bag (.bag, .db3, "
                ".mcap) or its folder, or say the "
                "format with --dataset.");
  if (std::find(kFormats.begin(), kFormats.end(), format) == kFormats.end()) {
    std::string known;
    for (const std::string& name : kFormats) known += (known.empty() ? "" : ", ") + name;
    throw Error("unknown data set format", format, "Known are: " + known + ".");
  }
  Drive drive = open_drive(spec, format, options);
  settle_length_unit(drive, options.points_unit);
  join_parts(drive);
  settle_vertical_angles(drive, options.kitti_correction, options.first);
  settle_sweep(drive, options.sweep, options.first);
  return make_source(std::move(drive), options);
}

}  // namespace hp2
