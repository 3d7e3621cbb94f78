#include "player/sweep/vertical_angles.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hp2 {
namespace {

constexpr int kBeams = 64, kColumns = 1000;

/// A scan of an HDL-64E, as KITTI writes it down: ring by ring, millimetres, hundredths.
Scan kitti_scan() {
  Scan scan;
  for (int beam = 0; beam < kBeams; ++beam) {
    const double elevation = (2.0 - 26.8 * beam / (kBeams - 1.0)) * M_PI / 180.0;
    for (int column = 0; column < kColumns; ++column) {
      const double azimuth = 2.0 * M_PI * (column + 0.5) / kColumns,
                   range = 5.0 + 0.013 * column + 0.1 * beam;
      const auto rounded = [](double v) { return static_cast<float>(std::round(1000.0 * v) / 1000.0); };
      scan.x.push_back(rounded(range * std::cos(elevation) * std::cos(azimuth)));
      scan.y.push_back(rounded(range * std::cos(elevation) * std::sin(azimuth)));
      scan.z.push_back(rounded(range * std::sin(elevation)));
      scan.intensity.push_back(static_cast<float>(column % 100) / 100.0F);
      scan.time.push_back(static_cast<float>(std::fmod(1.5 - azimuth / (2.0 * M_PI), 1.0)));
    }
  }
  return scan;
}

Drive drive_of(const Scan& scan) {
  Drive drive;
  drive.info.format = "generic";
  drive.scans.push_back({"", 0, 100'000, 0});
  drive.decode = [scan](const DriveScan&, Scan& out) { out = scan; };
  return drive;
}

double raised_deg(const Scan& scan, int correction) {
  Drive drive = drive_of(scan);
  settle_vertical_angles(drive, correction, 0);
  Scan read;
  drive.decode(drive.scans[0], read);
  EXPECT_EQ(drive.warnings.size(), read.z[0] == scan.z[0] ? 0U : 1U);
  const auto elevation = [](const Scan& s) { return std::atan2(s.z[0], std::hypot(s.x[0], s.y[0])); };
  return (elevation(read) - elevation(scan)) * 180.0 / M_PI;
}

TEST(VerticalAngles, CorrectsKittiScansInAnyOrderAndFile) {
  Scan scan = kitti_scan();
  EXPECT_NEAR(raised_deg(scan, -1), 0.205, 1e-3);
  EXPECT_EQ(raised_deg(scan, 0), 0.0);
  scan.time.clear();
  scan.intensity.clear();
  EXPECT_NEAR(raised_deg(scan, -1), 0.205, 1e-3);
}

TEST(VerticalAngles, LeavesOtherSensorsAlone) {
  Scan exact = kitti_scan();  // an HDL-64E of somebody else
  for (float& x : exact.x) x += 0.0004F;
  EXPECT_EQ(raised_deg(exact, -1), 0.0);
  EXPECT_NEAR(raised_deg(exact, 1), 0.205, 1e-3);
  Scan bright = kitti_scan();
  for (float& v : bright.intensity) v = std::round(255.0F * v);
  EXPECT_EQ(raised_deg(bright, -1), 0.0);
  Scan level = kitti_scan();  // rounded alike, of other beams
  for (float& z : level.z) z = 0.0F;
  EXPECT_EQ(raised_deg(level, -1), 0.0);
}

TEST(VerticalAngles, LooksPastADamagedScan) {
  Drive drive = drive_of(kitti_scan());
  drive.scans.insert(drive.scans.begin(), {"empty", 0, 0, 0});
  drive.decode = [inner = drive.decode](const DriveScan& entry, Scan& out) {
    out = Scan{};
    if (entry.path.empty()) inner(entry, out);
  };
  settle_vertical_angles(drive, -1, 0);
  ASSERT_EQ(drive.warnings.size(), 1U);
  EXPECT_THAT(drive.warnings[0], testing::HasSubstr("--vertical-correction off"));
}

}  // namespace
}  // namespace hp2
