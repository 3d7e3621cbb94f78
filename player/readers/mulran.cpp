// MulRan: Ouster/TIME.bin and global_pose.csv.
#include <filesystem>
#include <system_error>

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/readers/layout.hpp"
#include "player/readers/point_file.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kBeams = 64;
constexpr std::size_t kColumns = 1024;
constexpr std::size_t kPoints = kBeams * kColumns;

/// Where the Ouster sits on the vehicle.
Pose base_from_ouster() {
  constexpr double kDegree = M_PI / 180.0;
  const Eigen::Quaterniond q = Eigen::AngleAxisd(179.6654 * kDegree, Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(0.0003 * kDegree, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(0.0001 * kDegree, Eigen::Vector3d::UnitX());
  return {q, {1.7042, -0.021, 1.8047}};
}

}  // namespace

Drive open_mulran(const std::string& given) {
  const std::string folder = base_name(given) == "Ouster" ? parent_folder(given) : given;
  const std::string scans = folder + "/Ouster";
  const std::vector<std::string> names = list_bin_scans(scans);
  Drive drive;
  drive.info = {base_name(folder), "mulran", "os1-64", folder};
  drive.sweep_in_doubt = false;
  const auto stamps = stamps_of_names(scans, names, drive.warnings);
  const std::int64_t sweep_us = estimate_sweep(stamps);
  std::size_t damaged = 0;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string path = scans + "/" + names[i];
    std::error_code error;
    const bool whole = std::filesystem::file_size(path, error) == kPoints * 4 * sizeof(float) && !error;
    // A scan with lost columns gives no times of its points: its stamp is taken as the sweep's
    // middle.
    drive.scans.push_back({path, whole ? stamps[i] : stamps[i] + sweep_us / 2, whole ? sweep_us : 0, 0});
    damaged += !whole;
  }
  if (damaged > 0)
    drive.warnings.push_back(std::to_string(damaged) + " of " + std::to_string(names.size()) + " scans in " +
                             scans + " do not have 65536 points: they are used without times in the sweep");
  const std::string truth = folder + "/global_pose.csv";
  if (is_file(truth)) {
    const std::vector<StampedPose> base_poses = read_stamped_matrices(truth);
    for (const DriveScan& scan : drive.scans) {
      drive.ground_truth.push_back(pose_at(base_poses, scan.utime_end(), 1'000'000));
      if (drive.ground_truth.back())
        *drive.ground_truth.back() = *drive.ground_truth.back() * base_from_ouster();
    }
  } else {
    drive.warnings.push_back(truth + " is missing: there is no ground truth");
  }
  drive.decode = [](const DriveScan& entry, Scan& scan) {
    PointFile file;
    read_point_file(entry.path, file);
    move_points(file, scan);
    if (scan.size() != kPoints) return;
    scan.time.resize(kPoints);
    for (std::size_t i = 0; i < kPoints; ++i)
      scan.time[i] = static_cast<float>(i / kBeams) / static_cast<float>(kColumns);
  };
  return drive;
}

}  // namespace hp2
