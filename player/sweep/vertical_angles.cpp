#include "player/sweep/vertical_angles.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "common/error.hpp"
#include "common/sensor.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kFewestPoints = 60'000;  // of an HDL-64E's scan
constexpr std::size_t kMostLookedAt = 3;       // scans; some may be damaged
constexpr std::size_t kSampled = 11;           // every so-many-th point is looked at

/// Whether a float is the nearest one to a whole number of `unit`.
bool is_multiple(float value, double unit) {
  const double nearest = unit * std::round(static_cast<double>(value) / unit);
  return std::abs(static_cast<double>(value) - nearest) < 3e-7 * std::max(std::abs(nearest), unit);
}

/// From 25 degrees below the horizon to 3 above.
bool has_beams_of_hdl64(const Scan& scan) {
  std::vector<double> elevation_deg;
  for (std::size_t i = 0; i < scan.size(); i += kSampled) {
    const double horizontal = std::hypot(static_cast<double>(scan.x[i]), static_cast<double>(scan.y[i]));
    if (horizontal > 1.0) elevation_deg.push_back(std::atan2(scan.z[i], horizontal) * 180.0 / M_PI);
  }
  if (elevation_deg.empty()) return false;
  std::sort(elevation_deg.begin(), elevation_deg.end());
  const auto last = static_cast<double>(elevation_deg.size() - 1);
  const double low = elevation_deg[static_cast<std::size_t>(0.005 * last)];
  const double high = elevation_deg[static_cast<std::size_t>(0.995 * last)];
  return low > -27.0 && low < -20.0 && high > -2.0 && high < 4.5;
}

}  // namespace

bool looks_like_kitti(const Scan& scan) {
  if (scan.size() < kFewestPoints) return false;
  const bool bright = scan.intensity.size() == scan.size();
  std::size_t sampled = 0, rounded = 0, between = 0;
  for (std::size_t i = 0; i < scan.size(); i += kSampled) {
    ++sampled;
    bool good =
        is_multiple(scan.x[i], 0.001) && is_multiple(scan.y[i], 0.001) && is_multiple(scan.z[i], 0.001);
    if (bright) {
      const float v = scan.intensity[i];
      good = good && v >= 0.0F && v <= 1.0F && is_multiple(v, 0.01);
      between += v > 0.0F && v < 1.0F ? 1 : 0;
    }
    rounded += good ? 1 : 0;
  }
  if (100 * rounded < 99 * sampled || (bright && between == 0)) return false;
  return has_beams_of_hdl64(scan);
}

void correct_kitti_vertical_angle(Scan& scan) { raise_vertical_angles(scan, 0.205 * M_PI / 180.0); }

void settle_vertical_angles(Drive& drive, int correction, std::size_t first) {
  bool correct = correction > 0;
  if (correction < 0) correct = drive.info.format == "kitti" || drive.info.format == "kitti-raw";
  for (std::size_t i = first;
       correction < 0 && !correct && i < std::min(drive.scans.size(), first + kMostLookedAt); ++i) {
    Scan scan;
    try {
      drive.decode(drive.scans[i], scan);
    } catch (const Error&) {
      continue;  // it is reported when it is its turn to be played
    }
    correct = looks_like_kitti(scan);
    if (!correct && scan.size() > 0) break;
  }
  if (!correct) return;
  const bool usual =
      correction < 0 && drive.info.format == "kitti";  // the benchmark's scans are known to need it
  drive.decode = [inner = std::move(drive.decode)](const DriveScan& entry, Scan& scan) {
    inner(entry, scan);
    correct_kitti_vertical_angle(scan);
  };
  if (usual) return;
  drive.warnings.push_back(
      correction > 0
          ? "the vertical angles are corrected by 0.205 degrees, as chosen by hand"
          : "the scans are those of KITTI's HDL-64E: the vertical angles are corrected by 0.205 degrees "
            "(--vertical-correction off takes them as they are)");
}

}  // namespace hp2
