// Apollo (Southbay): pcds/N.pcd and poses/gt_poses.txt. Its scans are motion-compensated: no time in the
// sweep.
#include <charconv>
#include <cmath>
#include <limits>
#include <map>

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/readers/point_file.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {
namespace {

/// One line of gt_poses.txt.
struct Line {
  double time_s = std::numeric_limits<double>::quiet_NaN();
  std::optional<Pose> pose;
};

/// Lines by their index; those without index and time are left out.
std::map<std::int64_t, Line> read_lines(const std::string& path) {
  std::map<std::int64_t, Line> lines;
  const std::string text = read_text(path);
  for (const std::string_view line : split_lines(text)) {
    const std::vector<double> v = parse_numbers(line);
    if (v.size() < 2 || !(v[0] >= 0.0 && v[0] < 1e15) || !std::isfinite(v[1])) continue;
    Line entry;
    entry.time_s = v[1];
    if (v.size() >= 9) {
      const Eigen::Quaterniond q(v[8], v[5], v[6], v[7]);
      const Eigen::Vector3d t(v[2], v[3], v[4]);
      if (t.allFinite() && std::abs(q.norm() - 1.0) < 0.01) entry.pose = Pose(q, t);
    }
    lines.emplace(static_cast<std::int64_t>(v[0]), entry);
  }
  return lines;
}

/// Fills times that are not known from their neighbours; those at the ends are continued by 0.1 s.
void fill_gaps(std::vector<double>& times) {
  std::size_t last = times.size();  // the last known one
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (!std::isfinite(times[i])) continue;
    for (std::size_t k = last == times.size() ? 0 : last + 1; k < i; ++k)
      times[k] = last == times.size()
                     ? times[i] - 0.1 * static_cast<double>(i - k)
                     : times[last] + (times[i] - times[last]) * static_cast<double>(k - last) /
                                         static_cast<double>(i - last);
    last = i;
  }
  if (last == times.size()) return;
  for (std::size_t k = last + 1; k < times.size(); ++k)
    times[k] = times[last] + 0.1 * static_cast<double>(k - last);
}

}  // namespace

Drive open_apollo(const std::string& given) {
  const std::string folder = base_name(given) == "pcds" ? parent_folder(given) : given;
  const std::vector<std::string> names = list_files(folder + "/pcds", ".pcd");
  if (names.empty())
    throw Error("the drive holds no scan", folder + "/pcds", "Apollo's scans are .pcd files there.");
  Drive drive;
  drive.info = {base_name(folder), "apollo", "hdl64", folder};
  const std::string truth = folder + "/poses/gt_poses.txt";
  std::map<std::int64_t, Line> lines;
  if (is_file(truth)) lines = read_lines(truth);

  std::vector<double> times;
  std::size_t without = 0;
  for (const std::string& name : names) {
    const std::string digits = stem(name);
    std::int64_t index = -1;
    std::from_chars(digits.data(), digits.data() + digits.size(), index);
    const auto it = lines.find(index);
    times.push_back(it == lines.end() ? std::numeric_limits<double>::quiet_NaN() : it->second.time_s);
    drive.ground_truth.push_back(it == lines.end() ? std::nullopt : it->second.pose);
    without += !drive.ground_truth.back();
    drive.scans.push_back({folder + "/pcds/" + name, 0, 0, 0});
  }
  if (without > 0)
    drive.warnings.push_back(truth + " has no pose for " + std::to_string(without) + " of " +
                             std::to_string(names.size()) + " scans: they have no ground truth");
  fill_gaps(times);
  if (without == names.size() && lines.empty()) times.clear();
  const auto stamps = make_stamps(times, names.size(), truth, drive.warnings);
  for (std::size_t i = 0; i < names.size(); ++i) drive.scans[i].utime = stamps[i];
  drive.decode = [](const DriveScan& entry, Scan& scan) {
    PointFile file;
    read_point_file(entry.path, file);
    move_points(file, scan);
  };
  return drive;
}

}  // namespace hp2
