#include "player/readers/ground_truth.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "common/time_unit.hpp"
#include "player/readers/file_io.hpp"

namespace hp2 {

std::optional<Pose> pose_from_numbers(const double* numbers, std::size_t n) {
  if (n != 12 && n != 16) return std::nullopt;
  Eigen::Matrix<double, 3, 4> m;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c) m(r, c) = numbers[r * 4 + c];
  if (!m.allFinite()) return std::nullopt;
  const Eigen::Matrix3d rotation = m.leftCols<3>();
  // Pose files have few digits: a rotation up to 1 % is one.
  if (!(rotation.transpose() * rotation).isIdentity(0.01) || rotation.determinant() < 0.0)
    return std::nullopt;
  return Pose::from_matrix(m);
}

std::vector<std::optional<Pose>> read_kitti_poses(const std::string& path) {
  const std::string text = read_text(path);
  std::vector<std::optional<Pose>> poses;
  for (const std::string_view line : split_lines(text)) {
    const std::vector<double> numbers = parse_numbers(line);
    if (numbers.empty()) continue;
    poses.push_back(pose_from_numbers(numbers.data(), numbers.size()));
  }
  return poses;
}

std::optional<std::int64_t> parse_stamp(std::string_view word, double unit_s) {
  std::int64_t whole = 0;
  const auto [rest, error] = std::from_chars(word.data(), word.data() + word.size(), whole);
  if (unit_s == 1e-9 && error == std::errc() && rest == word.data() + word.size()) return whole / 1000;
  const std::vector<double> numbers = parse_numbers(word);
  if (numbers.size() != 1 || !(std::abs(numbers[0] * unit_s) < 4e12)) return std::nullopt;
  return std::llround(numbers[0] * unit_s * 1e6);
}

namespace {

/// The word number `index` of a line, words parted by blanks or commas; "" if there are fewer.
std::string_view word_of(std::string_view line, std::size_t index) {
  constexpr std::string_view kSeparators = " \t,;";
  for (std::size_t i = 0; (i = line.find_first_not_of(kSeparators, i)) != std::string_view::npos; --index) {
    const std::size_t end = std::min(line.find_first_of(kSeparators, i), line.size());
    if (index == 0) return line.substr(i, end - i);
    i = end;
  }
  return {};
}

/// Lines of a time, at word `skip`, and what `to_pose` makes of the numbers after it; sorted by time.
template <typename ToPose>
std::vector<StampedPose> read_stamped(const std::string& path, std::size_t skip, double unit_s,
                                      const ToPose& to_pose) {
  const std::string text = read_text(path);
  std::vector<StampedPose> poses;
  for (const std::string_view line : split_lines(text)) {
    if (line.empty() || line[0] == '#') continue;
    const auto stamp = parse_stamp(word_of(line, skip), unit_s);
    const std::vector<double> numbers = parse_numbers(line);
    if (!stamp || numbers.size() <= skip) continue;
    const std::optional<Pose> pose = to_pose(numbers.data() + skip + 1, numbers.size() - skip - 1);
    if (pose) poses.push_back({*stamp, *pose});
  }
  std::stable_sort(poses.begin(), poses.end(),
                   [](const StampedPose& a, const StampedPose& b) { return a.utime < b.utime; });
  return poses;
}

}  // namespace

std::vector<StampedPose> read_stamped_poses(const std::string& path, std::size_t skip, double unit_s) {
  return read_stamped(path, skip, unit_s, [](const double* p, std::size_t n) -> std::optional<Pose> {
    if (n < 7 || !std::all_of(p, p + 7, [](double v) { return std::isfinite(v); })) return std::nullopt;
    const Eigen::Quaterniond q(p[6], p[3], p[4], p[5]);
    if (std::abs(q.norm() - 1.0) > 0.01) return std::nullopt;
    return Pose(q, Eigen::Vector3d(p[0], p[1], p[2]));
  });
}

bool holds_stamped_poses(const std::string& path) {
  const std::string text = read_text(path);
  std::size_t eight = 0, others = 0;
  for (const std::string_view line : split_lines(text)) {
    if (line.empty() || line[0] == '#') continue;
    const std::vector<double> numbers = parse_numbers(line);
    const bool good = std::all_of(numbers.begin(), numbers.end(), [](double v) { return std::isfinite(v); });
    (good && numbers.size() == 8 ? eight : others) += 1;
  }
  return eight > others;
}

std::vector<StampedPose> read_tum_poses(const std::string& path) {
  const std::string text = read_text(path);
  std::vector<double> times;
  for (const std::string_view line : split_lines(text)) {
    if (line.empty() || line[0] == '#') continue;
    const std::vector<double> numbers = parse_numbers(line);
    if (!numbers.empty()) times.push_back(numbers[0]);
  }
  return read_stamped_poses(path, 0, unit_of_trajectory(times));
}

std::vector<StampedPose> read_stamped_matrices(const std::string& path) {
  return read_stamped(path, 0, 1e-9, pose_from_numbers);
}

std::optional<Pose> pose_at(const std::vector<StampedPose>& trajectory, std::int64_t utime,
                            std::int64_t max_gap_us) {
  if (trajectory.empty()) return std::nullopt;
  auto after = std::lower_bound(trajectory.begin(), trajectory.end(), utime,
                                [](const StampedPose& p, std::int64_t t) { return p.utime < t; });
  if (after != trajectory.end() && after->utime == utime) return after->pose;
  if (trajectory.size() >= 2) {
    // Beyond an end the last two poses are continued.
    after = std::clamp(after, trajectory.begin() + 1, trajectory.end() - 1);
    const StampedPose& a = *(after - 1);
    const StampedPose& b = *after;
    const bool near = utime >= a.utime - max_gap_us && utime <= b.utime + max_gap_us;
    if (near && b.utime > a.utime && b.utime - a.utime <= max_gap_us) {
      const double s = static_cast<double>(utime - a.utime) / static_cast<double>(b.utime - a.utime);
      return interpolate(a.pose, b.pose, s);
    }
    const StampedPose& nearest = std::abs(utime - a.utime) <= std::abs(b.utime - utime) ? a : b;
    if (std::abs(nearest.utime - utime) > max_gap_us) return std::nullopt;
    return nearest.pose;
  }
  if (std::abs(trajectory[0].utime - utime) > max_gap_us) return std::nullopt;
  return trajectory[0].pose;
}

std::vector<std::optional<Pose>> shift_poses(const std::vector<std::optional<Pose>>& poses,
                                             const std::vector<std::int64_t>& known_us,
                                             const std::vector<std::int64_t>& later_us) {
  std::vector<StampedPose> trajectory;
  for (std::size_t i = 0; i < std::min(poses.size(), known_us.size()); ++i)
    if (poses[i]) trajectory.push_back({known_us[i], *poses[i]});
  std::vector<std::optional<Pose>> shifted(later_us.size());
  for (std::size_t i = 0; i < std::min(later_us.size(), poses.size()); ++i)
    if (poses[i]) shifted[i] = pose_at(trajectory, later_us[i], 10'000'000);
  return shifted;
}

}  // namespace hp2
