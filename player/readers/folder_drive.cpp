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
#include "player/readers/point_folder.hpp"
#include "player/readers/same_content.hpp"
#include "player/sweep/clock.hpp"
#include "player/sweep/time_table.hpp"

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
  else if (is_folder(folder + "/lidar") && list_scan_files(folder, layout.warnings).empty())
    layout.scans = folder + "/lidar";
  if (is_file(folder)) {  // one scan
    layout.base = layout.scans = parent_folder(folder);
    layout.names = {base_name(folder)};
    return layout;
  }
  layout.warnings.clear();
  layout.names = list_scan_files(layout.scans, layout.warnings);
  if (layout.names.empty())
    throw Error("the folder holds no scan", layout.scans,
                "Scans are .bin, .pcd, .ply, .las, .npy or text (.xyz, .csv) files, in it or in velodyne/.");
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
  if (good < poses.size() && good > 0)
    warnings.push_back(path + " has poses for " + std::to_string(good) + " of " +
                       std::to_string(poses.size()) + " scans: the others have no ground truth");
  if (good == 0) {
    poses.clear();
    warnings.push_back(
        path +
        " holds no pose that is understood (12 numbers a line, or a time and 7): there is no ground truth");
  }
  return poses;
}

/// The entries that are kept, in their new order.
template <typename T>
void reorder(std::vector<T>& all, const std::vector<std::size_t>& order) {
  std::vector<T> kept;
  for (const std::size_t i : order)
    if (i < all.size()) kept.push_back(std::move(all[i]));
  all = std::move(kept);
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

void set_kitti_ground_truth(const Layout& layout, const std::vector<std::size_t>& order, Drive& drive) {
  std::string path = layout.base + "/poses.txt";
  if (!is_file(path)) path = layout.base + "/../../poses/" + base_name(layout.base) + ".txt";
  if (!is_file(path)) return;
  drive.ground_truth = read_poses(layout, path, drive.warnings);
  reorder(drive.ground_truth, order);
  if (const auto camera_from_lidar = kitti_camera_from_lidar(layout.base + "/calib.txt"))
    to_lidar_frame(*camera_from_lidar, drive.ground_truth);
  else
    drive.warnings.push_back(layout.base + "/calib.txt has no line 'Tr:': " + path +
                             " is taken to be in the LiDAR's frame");
}

/// Poses of a file of times and poses (TUM) at the ends of the sweeps.
void set_stamped_ground_truth(const std::string& path, Drive& drive) {
  constexpr std::int64_t kMostGap_us = 1'000'000;
  const std::vector<StampedPose> poses = read_tum_poses(path);
  std::size_t good = 0;
  for (const DriveScan& scan : drive.scans) {
    drive.ground_truth.push_back(pose_at(poses, scan.utime_end(), kMostGap_us));
    good += drive.ground_truth.back() ? 1 : 0;
  }
  if (good == drive.scans.size()) return;
  drive.warnings.push_back(path + " (time and pose per line) has poses for " + std::to_string(good) + " of " +
                           std::to_string(drive.scans.size()) + " scans" +
                           (good == 0 ? ": its times are not of the scans' clock" : ""));
  if (good == 0) drive.ground_truth.clear();
}

void set_generic_ground_truth(const Layout& layout, const MendedStamps& clock, bool has_times, Drive& drive) {
  const std::string end_path = layout.base + "/poses_end.txt";
  const std::string poses_path = layout.base + "/poses.txt";
  const bool at_end = has_times && is_file(end_path);
  const std::string path = at_end ? end_path : poses_path;
  if (!is_file(path)) return;
  if (holds_stamped_poses(path)) return set_stamped_ground_truth(path, drive);
  drive.ground_truth = read_poses(layout, path, drive.warnings);
  reorder(drive.ground_truth, clock.order);
  if (at_end || !has_times || drive.ground_truth.empty()) return;
  std::vector<std::int64_t> ends;
  for (const DriveScan& scan : drive.scans) ends.push_back(scan.utime_end());
  drive.ground_truth = shift_poses(drive.ground_truth, clock.stamps_us, ends);
}

/// Reads ptimes/NAME.bin: float32 or float64, one per point.
void read_ptimes(const std::string& path, std::size_t n, std::vector<double>& times) {
  thread_local FileBuffer buffer;
  const std::string_view bytes = buffer.load(path);
  const bool wide = n > 0 && bytes.size() == n * sizeof(double);
  if (!wide && bytes.size() != n * sizeof(float))
    throw Error(
        "the times in the sweep do not fit the scan (" + std::to_string(bytes.size()) + " bytes for " +
            std::to_string(n) + " points)",
        path,
        "It must hold one float32 in 0..1 for each point; without the folder ptimes/ there is no deskewing.");
  Column column;
  column.first = bytes.data();
  column.stride = wide ? sizeof(double) : sizeof(float);
  column.type = wide ? ScalarType::kFloat64 : ScalarType::kFloat32;
  read_column(column, n, times);
}

/// Whether times are what ptimes/ should hold: from about 0 on, about 1 at most, and not the seconds of a
/// sweep of `step_us`.
bool are_shares_of_sweep(const std::vector<std::vector<double>>& samples, std::int64_t step_us) {
  std::size_t good = 0;
  for (const std::vector<double>& times : samples) {
    const auto [low, high] = std::minmax_element(times.begin(), times.end());
    const double steps = (*high - *low) * 1e6 / static_cast<double>(step_us);
    good += *low > -1e-3 && *low < 0.2 && *high < 2.0 && !(steps > 0.5 && steps < 1.3) ? 1 : 0;
  }
  return 2 * good >= samples.size();
}

/// Times [s] of the scans, and where they come from.
struct FoundTimes {
  std::vector<double> times_s;  ///< Empty: none were found.
  std::string where;
  bool are_starts = false;  ///< Of the sweeps' starts, not of their middles.
};

FoundTimes find_times(const Layout& layout, const SourceOptions& options,
                      std::vector<std::string>& warnings) {
  FoundTimes found;
  found.where = layout.base + "/times.txt";
  if (is_file(found.where)) {
    TimeTable table = read_times(found.where, options.times_unit);
    warnings.insert(warnings.end(), table.warnings.begin(), table.warnings.end());
    found.times_s = pick_lines(layout, table.times_s);
  } else if (stamp_of_name(layout.names.front()) >= 0) {
    for (const std::string& name : layout.names) {
      const std::int64_t stamp = stamp_of_name(name);
      found.times_s.push_back(stamp >= 0 ? static_cast<double>(stamp) * 1e-6
                                         : std::numeric_limits<double>::quiet_NaN());
    }
    found.where = layout.scans;
    found.are_starts = true;  // drivers name a file by its header's stamp, the sweep's start
  }
  found.times_s.resize(layout.names.size(), std::numeric_limits<double>::quiet_NaN());
  return found;
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
  std::vector<std::string> paths;
  for (const DriveScan& scan : drive.scans) paths.push_back(scan.path);
  const PointReading reading = find_reading(paths, options.bin_layout, drive.warnings);

  const FoundTimes found = find_times(layout, options, drive.warnings);
  MendOptions mend;
  mend.same_points = [&drive](std::size_t a, std::size_t b) {
    return same_content(PartFile(drive.scans[a].path), PartFile(drive.scans[b].path));
  };
  MendedStamps clock = mend_stamps(found.times_s, found.where, mend);
  drive.warnings.insert(drive.warnings.end(), clock.warnings.begin(), clock.warnings.end());
  const std::vector<std::int64_t>& stamps = clock.stamps_us;
  reorder(drive.scans, clock.order);

  const std::string ptimes = !kitti && is_folder(layout.base + "/ptimes") ? layout.base + "/ptimes/" : "";
  TimeUnit unit;
  bool has_times = !ptimes.empty();
  if (!kitti) {
    const TimeSamples samples = sample_times(stamps, [&](std::size_t i, PointFile& file) {
      reading.read(drive.scans[i].path, file);
      if (!ptimes.empty())
        read_ptimes(ptimes + stem(base_name(drive.scans[i].path)) + ".bin", file.scan.size(), file.raw_time);
    });
    has_times = has_times || !samples.raw.empty();
    const std::int64_t step_us = estimate_sweep(stamps);
    if (!ptimes.empty() && are_shares_of_sweep(samples.raw, step_us)) {
      unit.duration_us = step_us;
      unit.normalised = true;
    } else if (has_times) {
      unit = find_time_unit(samples.raw, step_us, 0.0, samples.stamps_us);
    }
    const std::string& where = ptimes.empty() ? layout.scans : ptimes;
    if (!samples.raw.empty() && unit.unit_s == 0.0 && !unit.normalised)
      drive.warnings.push_back("the unit of the points' times in " + where +
                               " cannot be told: each scan's times are stretched over a whole sweep");
    else if (!ptimes.empty() && (!unit.normalised || unit.offset != 0.0) && !samples.raw.empty())
      drive.warnings.push_back("the points' times in " + where + " are not 0..1: they are read as " +
                               describe(unit));
  }
  set_times(drive, stamps, has_times ? unit.duration_us : 0);
  drive.stamp_in_sweep = found.are_starts ? 0.0 : 0.5;
  if (found.are_starts || unit.absolute)
    for (std::size_t i = 0; i < stamps.size(); ++i) drive.scans[i].utime = stamps[i] + unit.start_us;
  drive.time_in_sweep = has_times ? describe(unit) : "";

  if (kitti)
    set_kitti_ground_truth(layout, clock.order, drive);
  else
    set_generic_ground_truth(layout, clock, has_times, drive);

  drive.decode = [unit, ptimes, has_times, reading](const DriveScan& entry, Scan& scan) {
    thread_local PointFile file;
    reading.read(entry.path, file);
    move_points(file, scan);
    if (!ptimes.empty())
      read_ptimes(ptimes + stem(base_name(entry.path)) + ".bin", scan.size(), file.raw_time);
    if (has_times) apply_times(file.raw_time, unit, scan);
  };
  return drive;
}

}  // namespace hp2
