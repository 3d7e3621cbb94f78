// KITTI raw data: a drive's folder DATE_drive_NNNN_sync.
#include <algorithm>
#include <charconv>
#include <cmath>

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/readers/point_file.hpp"
#include "player/sweep/clock.hpp"
#include "player/sweep/time_table.hpp"

namespace hp2 {
namespace {

/// Times [s] of a file of dates, one per line; none if the file is missing.
std::vector<double> read_date_times(const std::string& path) {
  std::vector<double> times;
  if (!is_file(path)) return times;
  const std::string text = read_text(path);
  for (const std::string_view line : split_lines(text))
    if (!line.empty()) times.push_back(parse_date_time(line));
  return times;
}

/// The frame number that a file is named by; its place in the list if it is named otherwise.
std::size_t frame_of(const std::string& name, std::size_t place) {
  const std::string digits = stem(name);
  std::size_t frame = 0;
  const auto [rest, error] = std::from_chars(digits.data(), digits.data() + digits.size(), frame);
  return error == std::errc() && rest == digits.data() + digits.size() ? frame : place;
}

/// The times of the given frames; empty if one of them has none.
std::vector<double> pick(const std::vector<double>& times, const std::vector<std::size_t>& frames) {
  std::vector<double> picked;
  for (const std::size_t frame : frames) {
    if (frame >= times.size()) return {};
    picked.push_back(times[frame]);
  }
  return picked;
}

/// `velo_from_imu` of calib_imu_to_velo.txt: lines "R: 9 numbers" and "T: 3 numbers".
std::optional<Pose> read_velo_from_imu(const std::string& folder) {
  std::string path = folder + "/calib_imu_to_velo.txt";
  if (!is_file(path)) path = folder + "/../calib_imu_to_velo.txt";
  if (!is_file(path)) return std::nullopt;
  const std::string text = read_text(path);
  std::vector<double> r, t;
  for (const std::string_view line : split_lines(text)) {
    if (line.substr(0, 2) == "R:") r = parse_numbers(line.substr(2));
    if (line.substr(0, 2) == "T:") t = parse_numbers(line.substr(2));
  }
  if (r.size() != 9 || t.size() != 3) return std::nullopt;
  const double m[12] = {r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2]};
  return pose_from_numbers(m, 12);
}

/// Mercator projection scaled at the first latitude, as the KITTI devkit does it.
std::optional<Pose> pose_of_oxts(const std::vector<double>& v, double scale) {
  constexpr double kEarthRadius_m = 6378137.0;
  if (v.size() < 6 || !std::all_of(v.begin(), v.begin() + 6, [](double x) { return std::isfinite(x); }))
    return std::nullopt;
  const Eigen::Vector3d t(scale * v[1] * M_PI / 180.0 * kEarthRadius_m,
                          scale * kEarthRadius_m * std::log(std::tan((90.0 + v[0]) * M_PI / 360.0)), v[2]);
  const Eigen::Quaterniond q = Eigen::AngleAxisd(v[5], Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(v[4], Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(v[3], Eigen::Vector3d::UnitX());
  return t.allFinite() ? std::optional<Pose>(Pose(q, t)) : std::nullopt;
}

/// LiDAR poses at the ends of the sweeps, the first one the identity.
void set_ground_truth(const std::string& folder, const std::vector<std::size_t>& frames, Drive& drive) {
  const std::string data = folder + "/oxts/data";
  const std::vector<std::string> names = list_files(data, ".txt");
  if (names.empty()) {
    drive.warnings.push_back(folder + " has no oxts/data: there is no ground truth");
    return;
  }
  const std::optional<Pose> velo_from_imu = read_velo_from_imu(folder);
  if (!velo_from_imu) {
    drive.warnings.push_back(
        "calib_imu_to_velo.txt is missing or damaged in " + folder +
        " and the folder above: the ground truth cannot be brought into the LiDAR's frame");
    return;
  }
  const std::vector<double> times = read_date_times(folder + "/oxts/timestamps.txt");
  const Pose imu_from_velo = velo_from_imu->inverse();
  std::vector<StampedPose> trajectory;
  double scale = 0.0;
  std::optional<Pose> first;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::vector<double> numbers =
        parse_numbers(split_lines(read_text(data + "/" + names[i]) + "\n")[0]);
    if (scale == 0.0 && !numbers.empty()) scale = std::cos(numbers[0] * M_PI / 180.0);
    const std::optional<Pose> world_from_imu = pose_of_oxts(numbers, scale);
    const std::size_t frame = frame_of(names[i], i);
    StampedPose stamped;
    if (frame < times.size() && std::isfinite(times[frame])) {
      stamped.utime = std::llround(times[frame] * 1e6);
    } else {  // without its time it belongs to the middle of the scan of its number
      const auto it = std::find(frames.begin(), frames.end(), frame);
      if (it == frames.end()) continue;
      const DriveScan& scan = drive.scans[static_cast<std::size_t>(it - frames.begin())];
      stamped.utime = scan.utime + scan.duration_us / 2;
    }
    if (!world_from_imu) continue;
    const Pose pose = *world_from_imu * imu_from_velo;
    if (!first) first = pose;
    stamped.pose = first->inverse() * pose;
    trajectory.push_back(stamped);
  }
  std::stable_sort(trajectory.begin(), trajectory.end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.utime < b.utime; });
  for (const DriveScan& scan : drive.scans)
    drive.ground_truth.push_back(pose_at(trajectory, scan.utime_end(), 1'000'000));
}

/// Older copies of the data set: a line "x y z intensity" per point.
void parse_text_scan(const std::string& path, Scan& scan) {
  const std::string text = read_text(path);
  for (auto* column : {&scan.x, &scan.y, &scan.z, &scan.intensity}) column->clear();
  std::size_t number = 0;
  for (const std::string_view line : split_lines(text)) {
    ++number;
    const std::vector<double> v = parse_numbers(line);
    if (v.empty()) continue;
    if (v.size() != 4)
      throw Error("a line of the scan has " + std::to_string(v.size()) + " numbers",
                  path + ", line " + std::to_string(number), "Each must have four: x y z intensity.");
    scan.x.push_back(static_cast<float>(v[0]));
    scan.y.push_back(static_cast<float>(v[1]));
    scan.z.push_back(static_cast<float>(v[2]));
    scan.intensity.push_back(static_cast<float>(v[3]));
  }
}

}  // namespace

Drive open_kitti_raw(const std::string& given) {
  const std::string folder = base_name(given) == "velodyne_points" ? parent_folder(given) : given;
  const std::string points = folder + "/velodyne_points";
  std::vector<std::string> names = list_files(points + "/data", ".bin");
  const bool text = names.empty();
  if (text) names = list_files(points + "/data", ".txt");
  if (names.empty())
    throw Error("the drive holds no scan", points + "/data",
                "Scans are .bin files there (or .txt in older copies).");
  Drive drive;
  drive.info = {base_name(folder), "kitti-raw", "hdl64", folder};
  drive.sweep_in_doubt = false;
  std::vector<std::size_t> frames;
  for (std::size_t i = 0; i < names.size(); ++i) {
    frames.push_back(frame_of(names[i], i));
    drive.scans.push_back({points + "/data/" + names[i], 0, 0, 0});
  }

  const std::vector<double> middle = pick(read_date_times(points + "/timestamps.txt"), frames);
  const std::vector<double> start = pick(read_date_times(points + "/timestamps_start.txt"), frames);
  const std::vector<double> end = pick(read_date_times(points + "/timestamps_end.txt"), frames);
  const bool has_both = !start.empty() && !end.empty();
  const auto stamps =
      make_stamps(has_both ? start : middle, names.size(),
                  points + (has_both ? "/timestamps_start.txt" : "/timestamps.txt"), drive.warnings);
  const std::int64_t typical = estimate_sweep(stamps);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double length_us = has_both ? (end[i] - start[i]) * 1e6 : 0.0;
    const bool good = length_us > 1e4 && length_us < 1e6;
    drive.scans[i].duration_us = good ? std::llround(length_us) : typical;
    drive.scans[i].utime = has_both ? stamps[i] : stamps[i] - typical / 2;
  }
  set_ground_truth(folder, frames, drive);

  drive.decode = [text](const DriveScan& entry, Scan& scan) {
    if (text) {
      parse_text_scan(entry.path, scan);
    } else {
      thread_local PointFile file;
      read_point_file(entry.path, file);
      move_points(file, scan);
    }
    // The sweep begins and ends behind the car and turns clockwise.
    scan.time.resize(scan.size());
    for (std::size_t i = 0; i < scan.size(); ++i) {
      const float s = 0.5F * (1.0F - std::atan2(scan.y[i], scan.x[i]) / static_cast<float>(M_PI));
      scan.time[i] =
          s >= 0.0F && s <= 1.0F ? s : 0.0F;  // NaN points are dropped later, their times must be sound
    }
  };
  return drive;
}

}  // namespace hp2
