// Scans corrected by a calibration: known errors are undone, rings are told by their angles.
#include "common/sensor.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;
const std::vector<double> kAngles{10.0, 0.0, -5.0, -15.0};

SensorCalibration some_errors() {
  SensorCalibration c;
  c.vertical_angle_bias_deg = 0.2;
  c.ring_angles_deg = kAngles;
  c.ring_angle_offsets_deg = {0.05, -0.1, 0.0, 0.02};
  c.ring_range_offsets_m = {0.0, 0.03, -0.02, 0.01};
  return c;
}

void add_point(Scan& scan, double azimuth, double elevation_deg, double range) {
  const double e = elevation_deg * kDegree;
  scan.x.push_back(static_cast<float>(range * std::cos(e) * std::cos(azimuth)));
  scan.y.push_back(static_cast<float>(range * std::cos(e) * std::sin(azimuth)));
  scan.z.push_back(static_cast<float>(range * std::sin(e)));
}

TEST(SensorCorrection, UndoesTheErrorsOfEachRing) {
  const SensorCalibration c = some_errors();
  Scan measured, truth;
  for (std::size_t ring = 0; ring < kAngles.size(); ++ring) {
    for (int i = 0; i < 20; ++i) {
      const double range = 2.0 + 3.0 * i;
      add_point(truth, 0.3 * i, kAngles[ring] + c.vertical_angle_bias_deg + c.ring_angle_offsets_deg[ring],
                range);
      add_point(measured, 0.3 * i, kAngles[ring], range + c.ring_range_offsets_m[ring]);
    }
  }
  EXPECT_EQ(SensorCorrection(c).apply(measured), 1.0);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    EXPECT_NEAR(measured.x[i], truth.x[i], 1e-4);
    EXPECT_NEAR(measured.y[i], truth.y[i], 1e-4);
    EXPECT_NEAR(measured.z[i], truth.z[i], 1e-4);
  }
}

TEST(SensorCorrection, PointsOnNoRingGetTheBiasAloneAndAreCounted) {
  Scan scan, raised;
  for (int i = 0; i < 50; ++i) add_point(scan, 0.1 * i, -2.5, 10.0);
  raised = scan;
  raise_vertical_angles(raised, 0.2 * kDegree);
  EXPECT_EQ(SensorCorrection(some_errors()).apply(scan), 0.0);
  for (std::size_t i = 0; i < scan.size(); ++i) EXPECT_NEAR(scan.z[i], raised.z[i], 1e-5);
}

TEST(SensorCorrection, LeavesPointsThatAreNotFiniteAndThoseAtTheSensor) {
  Scan scan;
  scan.x = {NAN, 0.0F, INFINITY, 0.0F};
  scan.y = {1.0F, 0.0F, 1.0F, 0.0F};
  scan.z = {1.0F, 0.0F, 1.0F, 5.0F};
  SensorCorrection(some_errors()).apply(scan);
  EXPECT_TRUE(std::isnan(scan.x[0]));
  EXPECT_EQ(scan.z[1], 0.0F);
  EXPECT_TRUE(std::isinf(scan.x[2]));
  EXPECT_FLOAT_EQ(scan.z[3], 5.0F);  // straight up: no axis to turn about
}

TEST(SensorCalibration, PrintedItReadsBack) {
  SensorCalibration c = some_errors(), back;
  Config out, in;
  out.add(sensor_section(c));
  in.add(sensor_section(back));
  const test::TemporaryFolder folder;
  in.load(folder.write("sensor.yaml", out.print()));
  EXPECT_EQ(back.vertical_angle_bias_deg, c.vertical_angle_bias_deg);
  EXPECT_EQ(back.ring_angles_deg, c.ring_angles_deg);
  EXPECT_EQ(back.ring_angle_offsets_deg, c.ring_angle_offsets_deg);
  EXPECT_EQ(back.ring_range_offsets_m, c.ring_range_offsets_m);
  EXPECT_TRUE(corrects_scans(back));
  EXPECT_FALSE(corrects_scans({}));
}

TEST(SensorCalibration, RefusesAnAngleThatIsThereTwice) {
  SensorCalibration c;
  c.ring_angles_deg = {1.0, 2.0, 1.0};
  try {
    validate(c);
    FAIL();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("ring_angles_deg has an angle twice"));
  }
}

}  // namespace
}  // namespace hp2
