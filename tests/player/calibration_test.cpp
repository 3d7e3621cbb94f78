// Calibration on made-up scans of a room of planes, with known errors of the sensor.
#include <cmath>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.hpp"
#include "player/calibration/calibrate.hpp"
#include "player/calibration/calibration_file.hpp"
#include "player/calibration/find_rings.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;
const std::vector<double> kAngles{-24.0, -18.0, -12.0, -8.0, -4.0, 4.0, 12.0, 18.0};

/// A plane n p = d, seen from where n p < d.
struct Wall {
  Eigen::Vector3d normal;
  double distance;
};

/// Ground with slopes, two walls along the route, a ceiling.
std::vector<Wall> hall() {
  return {{Eigen::Vector3d(0.03, 0.0, -1.0).normalized(), 1.6},
          {Eigen::Vector3d(-0.05, 0.02, -1.0).normalized(), 1.9},
          {Eigen::Vector3d(0.0, 1.0, 0.0), 6.0},
          {Eigen::Vector3d(0.0, -1.0, 0.1).normalized(), 5.0},
          {Eigen::Vector3d(0.1, 0.0, 1.0).normalized(), 5.0}};
}

/// Range of the first wall along a ray, in the given frame.
double range_to(const std::vector<Wall>& walls, const Eigen::Vector3d& origin, const Eigen::Vector3d& ray) {
  double nearest = 1e9;
  for (const Wall& wall : walls) {
    const double facing = wall.normal.dot(ray);
    const double range = (wall.distance - wall.normal.dot(origin)) / facing;
    if (facing > 1e-3) nearest = std::min(nearest, range);
  }
  return nearest;
}

struct MadeUpSensor {
  double bias_deg = 0.0;
  std::vector<double> angle_offsets_deg = std::vector<double>(kAngles.size(), 0.0);
  std::vector<double> range_offsets_m = std::vector<double>(kAngles.size(), 0.0);
};

Scan scan_of(const Pose& pose, const MadeUpSensor& sensor, std::mt19937& random, std::int64_t number) {
  std::normal_distribution<double> noise(0.0, 0.01);
  const std::vector<Wall> walls = hall();
  Scan scan;
  scan.utime = number * 100'000;
  const auto along = [](double azimuth, double up) -> Eigen::Vector3d {
    return {std::cos(up) * std::cos(azimuth), std::cos(up) * std::sin(azimuth), std::sin(up)};
  };
  for (int column = 0; column < 300; ++column) {
    const double azimuth = 2.0 * M_PI * column / 300.0;
    for (std::size_t r = 0; r < kAngles.size(); ++r) {
      const double truth = (kAngles[r] + sensor.bias_deg + sensor.angle_offsets_deg[r]) * kDegree;
      const double range = range_to(walls, pose.translation, pose.rotation * along(azimuth, truth));
      if (range > 50.0) continue;
      const Eigen::Vector3d p =
          (range + sensor.range_offsets_m[r] + noise(random)) * along(azimuth, kAngles[r] * kDegree);
      scan.x.push_back(static_cast<float>(p.x()));
      scan.y.push_back(static_cast<float>(p.y()));
      scan.z.push_back(static_cast<float>(p.z()));
    }
  }
  return scan;
}

/// Windows of a walk through the hall, the sensor nodding and swaying; poses are off by some cm.
std::vector<CalibrationWindow> windows_of(const MadeUpSensor& sensor, std::size_t count, double speed_m) {
  std::mt19937 random(1);
  std::normal_distribution<double> pose_noise(0.0, 0.005);
  WindowConfig config;
  config.spacing_m = 0.5 * speed_m;
  WindowCutter cutter(config, kAngles);
  std::vector<CalibrationWindow> windows;
  for (std::int64_t i = 0; windows.size() < count && i < 24 * static_cast<std::int64_t>(count) + 1; ++i) {
    const double t = static_cast<double>(i);
    Vector6d twist;
    twist << 0, 0, 0, 0.06 * std::sin(0.5 * t), 0.06 * std::sin(0.37 * t), 0.3 * std::sin(0.05 * t);
    Pose pose = se3_exp(twist);
    pose.translation = Eigen::Vector3d(speed_m * (std::fmod(t, 48.0) - 12.0), std::sin(0.1 * t), 0.0);
    const Scan scan = scan_of(pose, sensor, random, i);
    Vector6d off;
    for (Eigen::Index k = 0; k < 6; ++k) off[k] = pose_noise(random) * (k < 3 ? 2.0 : 0.3);
    if (auto window = cutter.add(scan, pose * se3_exp(off))) windows.push_back(std::move(*window));
  }
  return windows;
}

TEST(FindRings, TellsRingsByTheirAnglesAndRefusesSmearedOnes) {
  std::mt19937 random(2);
  std::vector<Scan> scans{scan_of({}, {}, random, 0)};
  const std::vector<double> rings = find_rings(scans);
  ASSERT_EQ(rings.size(), kAngles.size());
  for (std::size_t r = 0; r < rings.size(); ++r) EXPECT_NEAR(rings[r], kAngles[r], 0.02);
  for (std::size_t i = 0; i < scans[0].size(); ++i)
    scans[0].z[i] += 0.01F * static_cast<float>(i % 300);  // as compensated scans have it
  EXPECT_TRUE(find_rings(scans).empty());
  EXPECT_TRUE(find_rings({}).empty());
}

TEST(Calibration, RecoversBiasAnglesAndRangesOfRings) {
  MadeUpSensor sensor;
  sensor.bias_deg = 0.25;
  sensor.angle_offsets_deg = {0.05, -0.06, 0.02, 0.0, -0.05, 0.04, 0.03, -0.03};  // of mean 0
  sensor.range_offsets_m = {0.01, -0.02, 0.02, 0.0, -0.01, 0.015, -0.015, 0.0};
  std::vector<CalibrationWindow> windows = windows_of(sensor, 6, 0.4);
  const CalibrationConfig config;
  const CalibrationEstimate estimate = calibrate(windows, kAngles.size(), config, Parallel(2));
  EXPECT_EQ(doubt_about(estimate, config), "");
  EXPECT_NEAR(estimate.bias_deg, sensor.bias_deg, 0.03);
  EXPECT_LT(estimate.thickness_after_m, 0.7 * estimate.thickness_before_m);
  std::size_t known = 0;
  for (std::size_t r = 0; r < kAngles.size(); ++r) {
    const RingEstimate& ring = estimate.rings[r];
    EXPECT_NEAR(ring.angle_deg, sensor.bias_deg + sensor.angle_offsets_deg[r], 4.0 * ring.angle_sd_deg) << r;
    EXPECT_NEAR(ring.range_m, sensor.range_offsets_m[r], 4.0 * ring.range_sd_m) << r;
    if (ring.angle_known) {
      EXPECT_NEAR(ring.angle_deg, sensor.bias_deg + sensor.angle_offsets_deg[r], 0.03) << r;
    }
    known += ring.angle_known ? 1 : 0;
  }
  EXPECT_GE(known, 4U);
}

TEST(Calibration, RefusesDrivesThatDoNotDetermineIt) {
  MadeUpSensor sensor;
  sensor.bias_deg = 0.25;
  const CalibrationConfig config;
  std::vector<CalibrationWindow> none = windows_of(sensor, 3, 0.0);  // stands: spacing 0 takes every scan
  for (CalibrationWindow& window : none)
    for (CalibrationScan& scan : window) scan = window.front();  // and does not even sway
  const std::string stands = doubt_about(calibrate(none, kAngles.size(), config, Parallel(1)), config);
  EXPECT_THAT(stands, HasSubstr("vertical angle"));
  std::vector<CalibrationWindow> one = windows_of(sensor, 1, 0.4);
  EXPECT_THAT(doubt_about(calibrate(one, kAngles.size(), config, Parallel(1)), config),
              HasSubstr("moves too little"));
}

TEST(CalibrationFile, WritesWhatTheConfigurationReads) {
  CalibrationEstimate estimate;
  estimate.bias_deg = 0.2;
  estimate.rings.resize(2);
  estimate.rings[0] = {0.25, 0.01, 0.012, 0.001, 500, true, true};
  estimate.rings[1] = {0.9, 0.3, 0.2, 0.1, 3, false, false};
  const test::TemporaryFolder folder;
  write_calibration(folder / "sensor.yaml", estimate, {-5.0, 5.0}, "a drive");
  SensorCalibration back;
  Config config;
  config.add(sensor_section(back));
  config.load(folder / "sensor.yaml");
  EXPECT_EQ(back.vertical_angle_bias_deg, 0.2);
  EXPECT_EQ(back.ring_angles_deg, (std::vector<double>{-5.0, 5.0}));
  EXPECT_EQ(back.ring_angle_offsets_deg, (std::vector<double>{0.05, 0.0}));  // the second is not determined
  EXPECT_EQ(back.ring_range_offsets_m, (std::vector<double>{0.012, 0.0}));
  EXPECT_THROW(write_calibration(folder / "nowhere/sensor.yaml", estimate, {-5.0, 5.0}, "a drive"), Error);
}

}  // namespace
}  // namespace hp2
