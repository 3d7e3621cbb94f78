#include "common/evaluation/trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <Eigen/Geometry>
#include <spdlog/spdlog.h>

#include "common/atomic_file.hpp"
#include "common/error.hpp"
#include "common/time_unit.hpp"

namespace hp2 {

namespace {

constexpr double kRotationTolerance = 1e-3;
constexpr std::size_t kMostNumbersALine = 16;

std::string where(const std::string& name, std::size_t line) {
  return name + ", line " + std::to_string(line);
}

// The numbers of a line; blanks, tabs and commas separate.
std::vector<double> numbers(const std::string& line, const std::string& place) {
  std::vector<double> values;
  const char* p = line.c_str();
  while (true) {
    while (*p == ' ' || *p == '\t' || *p == ',' || *p == '\r') ++p;
    if (*p == '\0') return values;
    char* end = nullptr;
    const double value = std::strtod(p, &end);
    const bool separated = *end == '\0' || *end == ' ' || *end == '\t' || *end == ',' || *end == '\r';
    if (end == p || !separated || !std::isfinite(value) || values.size() == kMostNumbersALine) {
      const std::string rest(p);
      const std::string word = rest.substr(0, std::min<std::size_t>(rest.find_first_of(" \t,\r"), 24));
      throw Error("\"" + word + "\" is not a finite number that belongs here", place,
                  "A trajectory has 12 numbers a line (KITTI) or 8 (TUM: t x y z qx qy qz qw).");
    }
    values.push_back(value);
    p = end;
  }
}

Eigen::Matrix4d kitti_pose(const std::vector<double>& v, const std::string& place) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  for (int i = 0; i < 12; ++i) m(i / 4, i % 4) = v[i];
  const Eigen::Matrix3d r = m.topLeftCorner<3, 3>();
  const double off = (r * r.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (off > kRotationTolerance || r.determinant() < 0) {
    throw Error("the left 3x3 block is no rotation matrix", place,
                "The order of the 12 numbers is row by row: r11 r12 r13 tx r21 ... tz.");
  }
  return m;
}

Eigen::Matrix4d tum_pose(const std::vector<double>& v, const std::string& place) {
  const Eigen::Quaterniond q(v[7], v[4], v[5], v[6]);
  if (std::abs(q.norm() - 1.0) > 0.1) {
    throw Error("the quaternion's length is not 1", place,
                "The order of the 8 numbers is t x y z qx qy qz qw.");
  }
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = q.normalized().toRotationMatrix();
  m.topRightCorner<3, 1>() = Eigen::Vector3d(v[1], v[2], v[3]);
  return m;
}

Trajectory subset(const Trajectory& trajectory, const std::vector<std::size_t>& indices) {
  Trajectory out;
  for (const std::size_t i : indices) {
    out.poses.push_back(trajectory.poses[i]);
    if (trajectory.has_times()) out.times_s.push_back(trajectory.times_s[i]);
  }
  return out;
}

// Index of the entry of sorted `times` nearest to `t`, the earlier one of two.
std::size_t nearest(const std::vector<double>& times, double t) {
  const auto after = std::lower_bound(times.begin(), times.end(), t);
  if (after == times.begin()) return 0;
  if (after == times.end()) return times.size() - 1;
  const auto before = std::prev(after);
  return static_cast<std::size_t>((t - *before <= *after - t ? before : after) - times.begin());
}

std::pair<Trajectory, Trajectory> associate_by_time(const Trajectory& reference, const Trajectory& estimate,
                                                    const AssociationOptions& options,
                                                    const std::string& names) {
  const bool estimate_is_shorter = estimate.size() < reference.size();
  const auto& few = estimate_is_shorter ? estimate.times_s : reference.times_s;
  const auto& many = estimate_is_shorter ? reference.times_s : estimate.times_s;
  const double shift = estimate_is_shorter ? options.offset_s : -options.offset_s;
  std::vector<std::size_t> few_indices, many_indices;
  for (std::size_t i = 0; i < few.size(); ++i) {
    const std::size_t j = nearest(many, few[i] + shift);
    if (std::abs(many[j] - few[i] - shift) > options.max_difference_s) continue;
    few_indices.push_back(i);
    many_indices.push_back(j);
  }
  if (few_indices.empty()) {
    std::ostringstream text;
    text.precision(15);
    text << "Their times run from " << reference.times_s.front() << " to " << reference.times_s.back()
         << " s and from " << estimate.times_s.front() << " to " << estimate.times_s.back()
         << " s: set --offset or --max-difference.";
    throw Error("no two poses lie within " + std::to_string(options.max_difference_s) + " s of each other",
                names, text.str());
  }
  return {subset(reference, estimate_is_shorter ? many_indices : few_indices),
          subset(estimate, estimate_is_shorter ? few_indices : many_indices)};
}

}  // namespace

Trajectory parse_trajectory(const std::string& text, const std::string& name) {
  Trajectory out;
  const bool marked = text.compare(0, 3, "\xef\xbb\xbf") == 0;  // a byte order mark
  std::istringstream stream(marked ? text.substr(3) : text);
  std::string line;
  std::size_t line_number = 0, expected = 0;
  while (std::getline(stream, line)) {
    ++line_number;
    const std::size_t first = line.find_first_not_of(" \t\r");
    if (first == std::string::npos || line[first] == '#') continue;
    const std::string place = where(name, line_number);
    const std::vector<double> v = numbers(line, place);
    if (expected == 0 && (v.size() == 12 || v.size() == 8)) expected = v.size();
    if (v.size() != expected || expected == 0) {
      throw Error(std::to_string(v.size()) + " numbers in the line", place,
                  expected == 0
                      ? "A trajectory has 12 numbers a line (KITTI) or 8 (TUM: t x y z qx qy qz qw)."
                      : "The lines before it have " + std::to_string(expected) + ".");
    }
    if (expected == 12) {
      out.poses.push_back(kitti_pose(v, place));
      continue;
    }
    if (!out.times_s.empty() && v[0] <= out.times_s.back()) {
      throw Error("the time does not rise", place, "Sort the lines by time and leave out doubles.");
    }
    out.times_s.push_back(v[0]);
    out.poses.push_back(tum_pose(v, place));
  }
  if (out.poses.empty()) throw Error("the trajectory is empty", name, "It needs one pose a line.");
  const double unit_s = unit_of_trajectory(out.times_s);
  if (unit_s != 1.0) {
    spdlog::warn("{}: the times are read as {}", name, name_of_unit(unit_s));
    for (double& t : out.times_s) t *= unit_s;
  }
  return out;
}

Trajectory read_trajectory(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  if (!file || text.bad() || std::filesystem::is_directory(path)) {
    throw Error("the trajectory cannot be read", path, "Check the name and the permissions.");
  }
  return parse_trajectory(text.str(), path);
}

std::string format_trajectory(const Trajectory& trajectory, TrajectoryFormat format) {
  if (format == TrajectoryFormat::kTum && trajectory.times_s.size() != trajectory.size()) {
    throw Error("the trajectory has no times", "TUM format", "Write it in KITTI format.");
  }
  std::string out;
  char buffer[64];
  const auto put = [&](const char* pattern, double value, char end) {
    std::snprintf(buffer, sizeof buffer, pattern, value);
    out += buffer;
    out += end;
  };
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    const Eigen::Matrix4d& m = trajectory.poses[i];
    if (format == TrajectoryFormat::kKitti) {
      for (int k = 0; k < 12; ++k) put("%.12g", m(k / 4, k % 4), k == 11 ? '\n' : ' ');
      continue;
    }
    const Eigen::Quaterniond q(Eigen::Matrix3d(m.topLeftCorner<3, 3>()));
    put("%.6f", trajectory.times_s[i], ' ');  // microseconds, exact to the year 2200 in a double
    for (int k = 0; k < 3; ++k) put("%.12g", m(k, 3), ' ');
    for (int k = 0; k < 4; ++k) put("%.12g", q.coeffs()[k], k == 3 ? '\n' : ' ');
  }
  return out;
}

void write_trajectory(const std::string& path, const Trajectory& trajectory, TrajectoryFormat format) {
  write_file(path, format_trajectory(trajectory, format));
}

Trajectory make_trajectory(const std::vector<Pose>& poses) {
  Trajectory out;
  for (const Pose& pose : poses) {
    out.poses.push_back(Eigen::Matrix4d::Identity());
    out.poses.back().topRows<3>() = pose.matrix();
  }
  return out;
}

std::pair<Trajectory, Trajectory> associate(const Trajectory& reference, const Trajectory& estimate,
                                            const AssociationOptions& options,
                                            const std::string& reference_name,
                                            const std::string& estimate_name) {
  const std::string names = reference_name + " and " + estimate_name;
  if (reference.poses.empty() || estimate.poses.empty()) {
    throw Error("the trajectory is empty", reference.poses.empty() ? reference_name : estimate_name,
                "It needs one pose a line.");
  }
  if (reference.has_times() && estimate.has_times())
    return associate_by_time(reference, estimate, options, names);
  if (reference.size() == estimate.size()) return {reference, estimate};
  const std::string counts =
      std::to_string(reference.size()) + " and " + std::to_string(estimate.size()) + " poses";
  if (reference.has_times() != estimate.has_times()) {
    throw Error("one trajectory has times, the other has not, and they have " + counts, names,
                "Give both in TUM format, or both in KITTI format with one pose a scan.");
  }
  if (!options.common_part) {
    throw Error(
        "the trajectories have " + counts, names,
        "Without times they are compared line by line: add --common-part to compare the first poses of the "
        "longer one, or use TUM format.");
  }
  std::vector<std::size_t> first(std::min(reference.size(), estimate.size()));
  for (std::size_t i = 0; i < first.size(); ++i) first[i] = i;
  return {subset(reference, first), subset(estimate, first)};
}

}  // namespace hp2
