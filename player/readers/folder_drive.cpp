// The two layouts of a folder with velodyne/, times.txt and poses.txt: KITTI odometry and the generic one.
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/readers/layout.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {
namespace {

/// Where the parts of the drive lie.
struct Layout {
  std::string base;   ///< Folder of times.txt, poses.txt, calib.txt.
  std::string scans;  ///< Folder of the scans.
  std::vector<std::string> names;
  std::vector<std::string> warnings;
};

Layout find_layout(const std::string& folder) {
  Layout layout;
  layout.base = folder;
  layout.scans = folder;
  if (is_folder(folder + "/velodyne"))
    layout.scans = folder + "/velodyne";
  else if (base_name(folder) == "velodyne")
    layout.base = parent_folder(folder);
  std::size_t others = 0;
  for (const char* extension : {".bin", ".pcd", ".ply"}) {
    std::vector<std::string> names = list_files(layout.scans, extension);
    if (names.size() > layout.names.size()) std::swap(names, layout.names);
    others += names.size();
  }
  if (layout.names.empty())
    throw Error("the folder holds no scan", layout.scans,
                "Scans are .bin, .pcd or .ply files, in it or in velodyne/.");
  if (others > 0)
    layout.warnings.push_back(layout.scans + " holds scans of several kinds: the " + std::to_string(others) +
                              " files of the rarer kinds are left out");
  return layout;
}

/// Lines of times.txt or poses.txt that belong to the scans. A file with more lines than there are scans,
/// where the scans are named by number, has a line for each number (scans are missing); otherwise the first
/// lines are theirs.
std::vector<std::size_t> lines_of_scans(const Layout& layout, std::size_t n_lines) {
  std::vector<std::size_t> lines(layout.names.size());
  bool by_name = n_lines > lines.size();
  for (std::size_t i = 0; i < lines.size() && by_name; ++i) {
    const std::string name = stem(layout.names[i]);
    const auto [rest, error] = std::from_chars(name.data(), name.data() + name.size(), lines[i]);
    by_name = error == std::errc() && rest == name.data() + name.size() && lines[i] < n_lines &&
              (i == 0 || lines[i] > lines[i - 1]);
  }
  if (!by_name)
    for (std::size_t i = 0; i < lines.size(); ++i) lines[i] = i;
  return lines;
}

template <typename T>
std::vector<T> pick_lines(const Layout& layout, const std::vector<T>& all) {
  std::vector<T> picked;
  for (const std::size_t line : lines_of_scans(layout, all.size()))
    if (line < all.size()) picked.push_back(all[line]);
  return picked;
}

std::vector<std::optional<Pose>> read_poses(const Layout& layout, const std::string& path,
                                            std::vector<std::string>& warnings) {
  auto poses = pick_lines(layout, read_kitti_poses(path));
  const auto good = static_cast<std::size_t>(
      std::count_if(poses.begin(), poses.end(), [](const auto& p) { return p.has_value(); }));
  poses.resize(layout.names.size());
  if (good < poses.size())
    warnings.push_back(path + " has poses for " + std::to_string(good) + " of " +
                       std::to_string(poses.size()) + " scans: the others have no ground truth");
  if (good == 0) poses.clear();
  return poses;
}

/// Raw times of the first scans that can be read, to find their unit.
std::vector<std::vector<double>> sample_times(const Layout& layout) {
  std::vector<std::vector<double>> samples;
  for (std::size_t i = 0; i < std::min<std::size_t>(layout.names.size(), 5); ++i) {
    try {
      PointFile file;
      read_point_file(layout.scans + "/" + layout.names[i], file);
      if (!file.raw_time.empty()) samples.push_back(std::move(file.raw_time));
    } catch (const Error&) {
      // A damaged scan is reported when it is its turn to be read.
    }
  }
  return samples;
}

/// Sets the scans' times from stamps in the middle of the sweeps.
void set_times(Drive& drive, const std::vector<std::int64_t>& stamps, std::int64_t duration_us) {
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    drive.scans[i].utime = stamps[i] - duration_us / 2;
    drive.scans[i].duration_us = duration_us;
  }
}

/// LiDAR-frame poses out of camera-frame ones: Tr^-1 * pose * Tr.
void to_lidar_frame(const Pose& camera_from_lidar, std::vector<std::optional<Pose>>& poses) {
  const Pose lidar_from_camera = camera_from_lidar.inverse();
  for (auto& pose : poses)
    if (pose) pose = lidar_from_camera * *pose * camera_from_lidar;
}

void set_kitti_ground_truth(const Layout& layout, Drive& drive) {
  std::string path = layout.base + "/poses.txt";
  if (!is_file(path)) path = layout.base + "/../../poses/" + base_name(layout.base) + ".txt";
  if (!is_file(path)) return;
  drive.ground_truth = read_poses(layout, path, drive.warnings);
  if (const auto camera_from_lidar = kitti_camera_from_lidar(layout.base + "/calib.txt"))
    to_lidar_frame(*camera_from_lidar, drive.ground_truth);
  else
    drive.warnings.push_back(layout.base + "/calib.txt has no line 'Tr:': " + path +
                             " is taken to be in the LiDAR's frame");
}

void set_generic_ground_truth(const Layout& layout, const std::vector<std::int64_t>& stamps, bool has_times,
                              Drive& drive) {
  const std::string end_path = layout.base + "/poses_end.txt";
  const std::string path = layout.base + "/poses.txt";
  if (has_times && is_file(end_path)) {
    drive.ground_truth = read_poses(layout, end_path, drive.warnings);
  } else if (is_file(path)) {
    drive.ground_truth = read_poses(layout, path, drive.warnings);
    if (!has_times || drive.ground_truth.empty()) return;
    std::vector<std::int64_t> ends;
    for (const DriveScan& scan : drive.scans) ends.push_back(scan.utime_end());
    drive.ground_truth = shift_poses(drive.ground_truth, stamps, ends);
  }
}

/// Reads ptimes/NAME.bin: float32, one per point.
void read_ptimes(const std::string& path, Scan& scan) {
  FilePieces file(path);
  const auto refuse_unless_fitting = [&](std::size_t bytes) {
    if (bytes == scan.size() * sizeof(float)) return;
    throw Error(
        "the times in the sweep do not fit the scan (" + std::to_string(bytes) + " bytes for " +
            std::to_string(scan.size()) + " points)",
        path,
        "It must hold one float32 in 0..1 for each point; without the folder ptimes/ there is no deskewing.");
  };
  refuse_unless_fitting(file.size());
  std::vector<float>& time = scan.time;
  time.resize(scan.size());
  std::size_t done = 0;
  int bad = 0;  // branch-free, so that the compiler makes vectors of it
  for (std::string_view piece = file.next(); !piece.empty(); piece = file.next()) {
    float* const begin = time.data() + done / sizeof(float);
    float* const end = begin + piece.size() / sizeof(float);
    std::memcpy(begin, piece.data(), piece.size());
    for (float* t = begin; t != end; ++t) {
      bad |= static_cast<int>(!(std::abs(*t) <= std::numeric_limits<float>::max()));
      *t = std::min(std::max(*t, 0.0F), 1.0F);
    }
    done += piece.size();
  }
  refuse_unless_fitting(done);
  if (bad != 0) time.clear();  // no time rather than a wrong one
}

}  // namespace

Drive open_folder_drive(const std::string& folder, bool kitti, const SourceOptions& options) {
  Layout layout = find_layout(folder);
  Drive drive;
  drive.info.format = kitti ? "kitti" : "generic";
  drive.info.path = folder;
  drive.info.name = base_name(layout.base);
  drive.warnings = layout.warnings;
  for (const std::string& name : layout.names) drive.scans.push_back({layout.scans + "/" + name, 0, 0, 0});

  std::vector<double> times;
  const std::string times_path = layout.base + "/times.txt";
  bool stamps_are_starts = false;
  if (is_file(times_path)) {
    times = pick_lines(layout, read_times(times_path));
  } else if (stamp_of_name(layout.names.front()) >= 0) {
    for (const std::string& name : layout.names)
      times.push_back(static_cast<double>(stamp_of_name(name)) * 1e-6);
    stamps_are_starts = true;  // drivers name a file by its header's stamp, the sweep's start
  }
  const std::vector<std::int64_t> stamps =
      make_stamps(times, drive.scans.size(), stamps_are_starts ? layout.scans : times_path, drive.warnings);

  TimeUnit unit;
  const bool has_ptimes = !kitti && is_folder(layout.base + "/ptimes");
  bool has_times = has_ptimes;
  if (has_ptimes) {
    unit.duration_us = estimate_sweep(stamps);
  } else if (!kitti) {
    const auto samples = sample_times(layout);
    has_times = !samples.empty();
    if (has_times) unit = find_time_unit(samples, estimate_sweep(stamps));
    if (has_times && unit.unit_s == 0.0 && !unit.normalised)
      drive.warnings.push_back("the unit of the points' times in " + layout.scans +
                               " cannot be told: each scan's times are stretched over a whole sweep");
  }
  set_times(drive, stamps, has_times ? unit.duration_us : 0);
  if (stamps_are_starts)
    for (std::size_t i = 0; i < stamps.size(); ++i) drive.scans[i].utime = stamps[i] + unit.start_us;

  if (kitti)
    set_kitti_ground_truth(layout, drive);
  else
    set_generic_ground_truth(layout, stamps, has_times, drive);

  const bool correct = options.kitti_correction < 0 ? kitti : options.kitti_correction > 0;
  const std::string ptimes = has_ptimes ? layout.base + "/ptimes/" : "";
  drive.decode = [unit, correct, ptimes, has_times](const DriveScan& entry, Scan& scan) {
    thread_local PointFile file;
    read_point_file(entry.path, file);
    move_points(file, scan);
    if (correct) correct_kitti_vertical_angle(scan);
    if (!ptimes.empty())
      read_ptimes(ptimes + stem(base_name(entry.path)) + ".bin", scan);
    else if (has_times)
      apply_times(file.raw_time, unit, scan);
  };
  return drive;
}

}  // namespace hp2
