// Reference trajectories as data sets hold them, and the pose at the instant that a scan's pose refers to.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "player/scan_source.hpp"

namespace hp2 {

/// A 3x4 (12 numbers) or 4x4 (16 numbers) row-major matrix; nothing if it is not finite or its left block no
/// rotation.
std::optional<Pose> pose_from_numbers(const double* numbers, std::size_t n);

/// Reads a KITTI pose file: one matrix per line. A line without a valid pose gives an empty entry.
/// @throws Error if the file cannot be read
std::vector<std::optional<Pose>> read_kitti_poses(const std::string& path);

/// Reads lines of `time x y z qx qy qz qw`, with `skip` numbers before the time; time times `unit_s` is
/// seconds. Lines that are no pose are left out; the result is sorted by time.
/// @throws Error if the file cannot be read
std::vector<StampedPose> read_stamped_poses(const std::string& path, std::size_t skip, double unit_s);

/// Whether most lines of a file are a time and a pose (8 numbers, TUM).
bool holds_stamped_poses(const std::string& path);
/// Reads a TUM file, whose times may be in s, ms, us or ns.
std::vector<StampedPose> read_tum_poses(const std::string& path);

/// Reads lines of a time [ns] and the 12 numbers of a 3x4 matrix; otherwise as read_stamped_poses.
std::vector<StampedPose> read_stamped_matrices(const std::string& path);

/// A time as a word of digits, exact where a double would not be: whole nanoseconds (unit_s = 1e-9) or
/// seconds. Nothing if it is not a number, or not a possible time.
std::optional<std::int64_t> parse_stamp(std::string_view word, double unit_s);

/// Pose at `utime` from poses sorted by time: between its two neighbours, or from the nearest one if a
/// neighbour is further away than `max_gap_us`; up to `max_gap_us` beyond the ends. Nothing if no pose is
/// that near.
std::optional<Pose> pose_at(const std::vector<StampedPose>& trajectory, std::int64_t utime,
                            std::int64_t max_gap_us);

/// Pose at `later_us[i]` for each i from poses at `known_us[i]`, some of them missing.
std::vector<std::optional<Pose>> shift_poses(const std::vector<std::optional<Pose>>& poses,
                                             const std::vector<std::int64_t>& known_us,
                                             const std::vector<std::int64_t>& later_us);

}  // namespace hp2
