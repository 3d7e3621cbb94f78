#include "tests/datasets/dataset_writers.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include <fmt/format.h>

#include "common/atomic_file.hpp"
#include "common/error.hpp"
#include "player/readers/ground_truth.hpp"

namespace hp2::test {
namespace {

namespace fs = std::filesystem;

constexpr double kDegree = M_PI / 180.0;
constexpr std::int64_t kFarthestTruth_us = 1'000'000;

/// Little-endian bytes of a value, appended.
template <typename T>
void put(std::string& bytes, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

void put_xyz(std::string& bytes, const Scan& scan, std::size_t i) {
  put(bytes, scan.x[i]);
  put(bytes, scan.y[i]);
  put(bytes, scan.z[i]);
}

float intensity_of(const Scan& scan, std::size_t i) {
  return scan.intensity.empty() ? 0.0F : scan.intensity[i];
}

/// Intensity of 0..1 as a byte.
std::uint8_t intensity_byte(const Scan& scan, std::size_t i) {
  return static_cast<std::uint8_t>(std::lround(255.0F * std::clamp(intensity_of(scan, i), 0.0F, 1.0F)));
}

/// Offset of a point's instant from the start of the sweep [ns].
std::int64_t offset_ns(const Scan& scan, std::size_t i) {
  return std::llround(1e3 * static_cast<double>(scan.time[i]) * static_cast<double>(scan.duration_us));
}

void write(const std::string& path, const std::string& bytes) {
  fs::create_directories(fs::path(path).parent_path());
  write_file(path, bytes);
}

Pose truth_at(const std::vector<StampedPose>& truth, std::int64_t utime) {
  const auto pose = pose_at(truth, utime, kFarthestTruth_us);
  if (!pose)
    throw Error("the drive has no ground truth at " + std::to_string(utime) + " us", "dataset writer",
                "Only drives with ground truth all along can be written.");
  return *pose;
}

std::int64_t middle_us(const Scan& scan) { return scan.utime + scan.duration_us / 2; }

void need_times(const Scan& scan, const std::string& format) {
  if (scan.time.size() != scan.size() || scan.duration_us <= 0)
    throw Error("scan " + std::to_string(scan.sequence) + " has no times in the sweep", format,
                "This format has them: take another drive.");
}

std::string matrix_text(const Pose& pose, const char* separator) {
  const auto m = pose.matrix();
  std::string text;
  for (int k = 0; k < 12; ++k) text += (k == 0 ? "" : separator) + fmt::format("{:.12g}", m(k / 4, k % 4));
  return text;
}

std::string quaternion_text(const Pose& pose) {
  const auto& t = pose.translation;
  const auto& q = pose.rotation;
  return fmt::format("{:.9f} {:.9f} {:.9f} {:.12f} {:.12f} {:.12f} {:.12f}", t.x(), t.y(), t.z(), q.x(),
                     q.y(), q.z(), q.w());
}

/// Where the survey's coordinates have the drive's first pose: far from their origin, turned.
Pose world_from_drive() {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(2.1, Eigen::Vector3d::UnitZ())), {353069.25, 4026283.5, 19.5}};
}

// ---------------------------------------------------------------- KITTI odometry

/// A camera beside the LiDAR that looks ahead, x right, y down, z forward, not mounted quite straight.
Pose camera_from_lidar() {
  Eigen::Matrix3d axes;
  axes << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const Eigen::Quaterniond skewed(Eigen::AngleAxisd(0.014, Eigen::Vector3d(0.6, -0.64, 0.48)));
  return {skewed * Eigen::Quaterniond(axes), {-0.012, -0.054, -0.292}};
}

/// The benchmark's error: every point 0.205 degrees too low.
void add_vertical_angle_error(Scan& scan) {
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3d p(scan.x[i], scan.y[i], scan.z[i]);
    const double horizontal = p.head<2>().norm();
    if (!(horizontal > 0.0)) continue;
    const double elevation = std::atan2(p.z(), horizontal) - 0.205 * kDegree;
    const double scale = p.norm() * std::cos(elevation) / horizontal;
    scan.x[i] = static_cast<float>(p.x() * scale);
    scan.y[i] = static_cast<float>(p.y() * scale);
    scan.z[i] = static_cast<float>(p.norm() * std::sin(elevation));
  }
}

void write_kitti(const ScanSource& drive, const std::string& folder) {
  const Pose camera = camera_from_lidar();
  std::string times, poses;
  Pose first;
  std::int64_t first_us = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Scan raw = drive.read(i);
    const Pose pose = truth_at(drive.ground_truth(), middle_us(raw));
    if (i == 0) first = pose, first_us = middle_us(raw);
    Scan scan = motion_compensated(raw, drive.ground_truth());
    add_vertical_angle_error(scan);
    std::string bytes;
    for (std::size_t k = 0; k < scan.size(); ++k) put_xyz(bytes, scan, k), put(bytes, intensity_of(scan, k));
    write(folder + fmt::format("/velodyne/{:06}.bin", i), bytes);
    times += fmt::format("{:.6e}\n", 1e-6 * static_cast<double>(middle_us(raw) - first_us));
    poses += matrix_text(camera * (first.inverse() * pose) * camera.inverse(), " ") + "\n";
  }
  std::string calibration;
  for (int k = 0; k < 4; ++k)
    calibration += fmt::format("P{}: 7.2e+02 0 6.1e+02 0 0 7.2e+02 1.9e+02 0 0 0 1 0\n", k);
  write(folder + "/calib.txt", calibration + "Tr: " + matrix_text(camera, " ") + "\n");
  write(folder + "/times.txt", times);
  const fs::path sequence = fs::path(folder).lexically_normal();
  write((sequence / "../../poses" / (sequence.filename().string() + ".txt")).lexically_normal(), poses);
}

// ---------------------------------------------------------------- MulRan

/// One slot for each of 64 beams in each of 1024 columns; a beam without a return is a point at the origin.
std::string mulran_bytes(const Scan& scan) {
  constexpr std::size_t kBeams = 64, kColumns = 1024;
  std::vector<float> slots(kBeams * kColumns * 4, 0.0F);
  std::vector<std::size_t> used(kColumns, 0);
  for (std::size_t i = 0; i < scan.size(); ++i) {
    // The small share keeps a column's own time, which a float rounds either way, in its column.
    const auto column =
        std::min<std::size_t>(static_cast<std::size_t>(kColumns * scan.time[i] + 1e-3), kColumns - 1);
    if (used[column] == kBeams)
      throw Error("more than 64 points in 1/1024 of a sweep", "scan " + std::to_string(scan.sequence),
                  "MulRan's sensor has 64 beams and 1024 columns: take a drive with such a one.");
    float* slot = &slots[(column * kBeams + used[column]++) * 4];
    slot[0] = scan.x[i], slot[1] = scan.y[i], slot[2] = scan.z[i], slot[3] = intensity_of(scan, i);
  }
  return {reinterpret_cast<const char*>(slots.data()), slots.size() * sizeof(float)};
}

void write_mulran(const ScanSource& drive, const std::string& folder) {
  const Pose base_from_lidar(
      Eigen::Quaterniond(Eigen::AngleAxisd(179.6654 * kDegree, Eigen::Vector3d::UnitZ()) *
                         Eigen::AngleAxisd(0.0003 * kDegree, Eigen::Vector3d::UnitY()) *
                         Eigen::AngleAxisd(0.0001 * kDegree, Eigen::Vector3d::UnitX())),
      {1.7042, -0.021, 1.8047});
  const std::int64_t epoch = dataset_epoch_us("mulran");
  std::int64_t first = 0, last = 0;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Scan scan = drive.read(i);
    need_times(scan, "mulran");
    write(folder + fmt::format("/Ouster/{}.bin", (epoch + scan.utime) * 1000), mulran_bytes(scan));
    if (i == 0) first = scan.utime;
    last = scan.utime_end();
  }
  std::string csv;
  for (std::int64_t t = first - 100'000; t <= last + 100'000; t += 10'000) {  // 100 a second, as there
    const Pose base = world_from_drive() * truth_at(drive.ground_truth(), t) * base_from_lidar.inverse();
    csv += std::to_string((epoch + t) * 1000) + "," + matrix_text(base, ",") + "\n";
  }
  write(folder + "/global_pose.csv", csv);
}

// ---------------------------------------------------------------- HeLiPR

std::string helipr_bytes(const Scan& scan, const std::string& sensor) {
  std::string bytes;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    put_xyz(bytes, scan, i);
    const std::int64_t ns = offset_ns(scan, i);
    if (sensor == "avia") {
      put(bytes, intensity_byte(scan, i));
      put<std::uint8_t>(bytes, 0x10);                              // tag: a strong first return
      put<std::uint8_t>(bytes, static_cast<std::uint8_t>(i % 6));  // line
      put(bytes, static_cast<std::uint32_t>(ns));
    } else if (sensor == "ouster") {
      put(bytes, intensity_of(scan, i));
      put(bytes, static_cast<std::uint32_t>(ns));
      put<std::uint16_t>(bytes, intensity_byte(scan, i));              // reflectivity
      put<std::uint16_t>(bytes, static_cast<std::uint16_t>(i % 128));  // ring
      put<std::uint16_t>(bytes, 7);                                    // ambient
    } else if (sensor == "velodyne") {
      put(bytes, intensity_of(scan, i));
      put<std::uint16_t>(bytes, static_cast<std::uint16_t>(i % 16));  // ring
      put(bytes, 1e-9F * static_cast<float>(ns));
    } else {  // aeva
      const bool old = sensor == "aeva-old";
      put(bytes, old ? intensity_of(scan, i) : 0.5F);  // reflectivity
      put(bytes, -1.25F);                              // velocity
      put(bytes, static_cast<std::int32_t>(ns));
      put<std::uint8_t>(bytes, static_cast<std::uint8_t>(i % 64));  // line
      if (!old) put(bytes, intensity_of(scan, i));
    }
  }
  return bytes;
}

void write_helipr(const ScanSource& drive, const std::string& sensor, const std::string& folder) {
  const std::string name = sensor == "ouster"     ? "Ouster"
                           : sensor == "avia"     ? "Avia"
                           : sensor == "velodyne" ? "Velodyne"
                                                  : "Aeva";
  const std::int64_t epoch = dataset_epoch_us("helipr-" + sensor);
  std::string poses;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Scan scan = drive.read(i);
    need_times(scan, "helipr-" + sensor);
    const std::int64_t stamp_ns = (epoch + scan.utime) * 1000;
    write(folder + fmt::format("/LiDAR/{}/{}.bin", name, stamp_ns), helipr_bytes(scan, sensor));
    const Pose pose = world_from_drive() * truth_at(drive.ground_truth(), scan.utime);
    poses += fmt::format("{} {}\n", stamp_ns, quaternion_text(pose));
  }
  write(folder + "/LiDAR_GT/global_" + name + "_gt.txt", poses);
}

// ---------------------------------------------------------------- Apollo

std::string apollo_bytes(const Scan& scan, double time_s) {
  std::string bytes = fmt::format(
      "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity timestamp\nSIZE 4 4 4 "
      "1 8\n"
      "TYPE F F F U F\nCOUNT 1 1 1 1 1\nWIDTH {0}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA "
      "binary\n",
      scan.size());
  for (std::size_t i = 0; i < scan.size(); ++i) {
    put_xyz(bytes, scan, i);
    put(bytes, intensity_byte(scan, i));
    put(bytes, time_s);
  }
  return bytes;
}

void write_apollo(const ScanSource& drive, const std::string& folder) {
  const std::int64_t epoch = dataset_epoch_us("apollo");
  std::string poses;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const Scan raw = drive.read(i);
    const double time_s = 1e-6 * static_cast<double>(epoch + middle_us(raw));
    write(folder + fmt::format("/pcds/{}.pcd", i + 1),
          apollo_bytes(motion_compensated(raw, drive.ground_truth()), time_s));
    const Pose pose = world_from_drive() * truth_at(drive.ground_truth(), middle_us(raw));
    poses += fmt::format("{} {:.6f} {}\n", i + 1, time_s, quaternion_text(pose));
  }
  write(folder + "/poses/gt_poses.txt", poses);
}

}  // namespace

const std::vector<std::string>& dataset_formats() {
  static const std::vector<std::string> formats{"kitti",           "mulran",      "helipr-ouster",
                                                "helipr-avia",     "helipr-aeva", "helipr-aeva-old",
                                                "helipr-velodyne", "apollo"};
  return formats;
}

std::int64_t dataset_epoch_us(const std::string& format) {
  if (format == "kitti") return 0;  // counts from the first scan
  if (format == "mulran") return 1561000444'390857;
  if (format == "helipr-aeva-old") return 1691000000'000000;  // FORMATS: no intensity before 1691936557
  if (format == "apollo") return 1539297600'000000;
  return 1693000000'000000;
}

Scan motion_compensated(const Scan& scan, const std::vector<StampedPose>& truth) {
  Scan out = scan;
  out.time.clear();
  if (scan.time.empty()) return out;
  const Pose reference_from_world = truth_at(truth, middle_us(scan)).inverse();
  float last_time = -1.0F;
  Pose move;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    if (scan.time[i] != last_time) {  // points of one column share their instant
      last_time = scan.time[i];
      const auto offset = static_cast<double>(last_time) * static_cast<double>(scan.duration_us);
      move = reference_from_world * truth_at(truth, scan.utime + std::llround(offset));
    }
    const Eigen::Vector3d p = move * Eigen::Vector3d(scan.x[i], scan.y[i], scan.z[i]);
    out.x[i] = static_cast<float>(p.x());
    out.y[i] = static_cast<float>(p.y());
    out.z[i] = static_cast<float>(p.z());
  }
  return out;
}

void write_dataset(const ScanSource& drive, const std::string& format, const std::string& folder) {
  const auto& known = dataset_formats();
  if (std::find(known.begin(), known.end(), format) == known.end()) {
    std::string list;
    for (const std::string& name : known) list += (list.empty() ? "" : ", ") + name;
    throw Error("the data set format \"" + format + "\" is not known", folder, "There are: " + list + ".");
  }
  if (drive.ground_truth().size() < 2)
    throw Error("the drive has no ground truth", drive.info().name, "It is needed for the data set's own.");
  if (format == "kitti") return write_kitti(drive, folder);
  if (format == "mulran") return write_mulran(drive, folder);
  if (format == "apollo") return write_apollo(drive, folder);
  write_helipr(drive, format.substr(format.find('-') + 1), folder);
}

}  // namespace hp2::test
