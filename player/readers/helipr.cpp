// HeLiPR: LiDAR/SENSOR/TIME.bin of four sensors, each with its own record per point.
#include <algorithm>
#include <charconv>

#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/readers/layout.hpp"
#include "player/readers/point_file.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {
namespace {

/// One point's record: where its fields lie. All begin with float32 x y z.
struct Record {
  std::size_t bytes;
  std::size_t intensity;
  ScalarType intensity_type;
  std::size_t time;
  ScalarType time_type;
  double time_unit_s;
};

constexpr Record kOuster = {26, 12, ScalarType::kFloat32, 16, ScalarType::kUint32, 1e-9};
constexpr Record kAvia = {19, 12, ScalarType::kUint8, 15, ScalarType::kUint32, 1e-9};
constexpr Record kAeva = {29, 25, ScalarType::kFloat32, 20, ScalarType::kInt32, 1e-9};
constexpr Record kAevaOld = {25,  12, ScalarType::kFloat32, 20, ScalarType::kInt32,
                             1e-9};  // reflectivity only
constexpr Record kVelodyne = {22, 12, ScalarType::kFloat32, 18, ScalarType::kFloat32, 1.0};

/// Files of the Aeva up to this time [ns] have no intensity.
constexpr std::int64_t kLastOldAeva_ns = 1691936557946849179;

constexpr const char* kSensors[] = {"Ouster", "Avia", "Aeva", "Velodyne"};

Record record_of(const std::string& sensor, const std::string& path) {
  if (sensor == "Ouster") return kOuster;
  if (sensor == "Avia") return kAvia;
  if (sensor == "Velodyne") return kVelodyne;
  const std::string digits = stem(base_name(path));
  std::int64_t time_ns = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), time_ns);
  return time_ns <= kLastOldAeva_ns ? kAevaOld : kAeva;
}

void read_records(const std::string& sensor, const std::string& path, PointFile& out) {
  thread_local FileBuffer buffer;
  const std::string_view bytes = buffer.load(path);
  const Record r = record_of(sensor, path);
  if (bytes.size() % r.bytes != 0)
    throw Error(
        "the scan is truncated or of another sensor (" + std::to_string(bytes.size()) +
            " bytes are no multiple of " + std::to_string(r.bytes) + ")",
        path,
        "A point of HeLiPR's " + sensor + " has " + std::to_string(r.bytes) + " bytes; copy the file again.");
  const char* p = bytes.data();
  const auto column = [&](std::size_t offset, ScalarType type) {
    return Column{p + offset, r.bytes, type, false};
  };
  read_points(
      {column(0, ScalarType::kFloat32), column(4, ScalarType::kFloat32), column(8, ScalarType::kFloat32),
       column(r.intensity, r.intensity_type), column(r.time, r.time_type)},
      bytes.size() / r.bytes, out);
}

}  // namespace

std::vector<std::string> helipr_sensor_folders(const std::string& folder) {
  std::vector<std::string> found;
  const std::string name = base_name(folder);
  const bool is_sensor = std::find(std::begin(kSensors), std::end(kSensors), name) != std::end(kSensors);
  if (is_sensor && base_name(parent_folder(folder)) == "LiDAR") return {folder};
  const std::string lidar = name == "LiDAR" ? folder : folder + "/LiDAR";
  for (const char* sensor : kSensors)
    if (is_folder(lidar + "/" + sensor)) found.push_back(lidar + "/" + sensor);
  return found;
}

Drive open_helipr(const std::string& given, const SourceOptions& options) {
  std::vector<std::string> folders = helipr_sensor_folders(given);
  if (!options.topic.empty())
    folders.erase(std::remove_if(folders.begin(), folders.end(),
                                 [&](const std::string& f) { return base_name(f) != options.topic; }),
                  folders.end());
  if (folders.empty())
    throw Error("the drive has no sensor's folder", given,
                "HeLiPR's scans are in LiDAR/Ouster, Avia, Aeva or Velodyne.");
  if (folders.size() > 1)
    throw Error("the drive has several sensors", given, "Name one of them, e.g. " + folders[0] + ".");
  const std::string& scans = folders[0];
  const std::string sensor = base_name(scans);
  const std::string drive_folder = parent_folder(parent_folder(scans));
  const std::vector<std::string> names = list_bin_scans(scans);
  Drive drive;
  drive.info = {base_name(drive_folder) + "-" + sensor, "helipr", sensor, given};
  drive.sweep_in_doubt = false;
  const auto stamps = stamps_of_names(scans, names, drive.warnings);

  std::vector<std::vector<double>> samples;
  for (std::size_t i = 0; i < std::min<std::size_t>(names.size(), 5); ++i) {
    try {
      PointFile file;
      read_records(sensor, scans + "/" + names[i], file);
      samples.push_back(std::move(file.raw_time));
    } catch (const Error&) {
      // A damaged scan is reported when it is its turn to be read.
    }
  }
  const TimeUnit unit =
      find_time_unit(samples, estimate_sweep(stamps), record_of(sensor, names.front()).time_unit_s);
  for (std::size_t i = 0; i < names.size(); ++i)
    drive.scans.push_back({scans + "/" + names[i], stamps[i] + unit.start_us, unit.duration_us, 0});

  const std::string truth = drive_folder + "/LiDAR_GT/global_" + sensor + "_gt.txt";
  if (is_file(truth)) {
    const std::vector<StampedPose> poses = read_stamped_poses(truth, 0, 1e-9);
    for (const DriveScan& scan : drive.scans)
      drive.ground_truth.push_back(pose_at(poses, scan.utime_end(), 1'000'000));
  } else {
    drive.warnings.push_back(truth + " is missing: there is no ground truth");
  }
  drive.decode = [sensor, unit](const DriveScan& entry, Scan& scan) {
    thread_local PointFile file;
    read_records(sensor, entry.path, file);
    move_points(file, scan);
    apply_times(file.raw_time, unit, scan);
  };
  return drive;
}

}  // namespace hp2
