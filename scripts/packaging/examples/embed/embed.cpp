// Embeds the odometry of HP2-SLAM in a program, without LCM: scans in, poses out. The scans are made up: a
// sensor drives along a street of houses with front gardens. Prints the error of the last position.
#include <cmath>
#include <cstdio>
#include <limits>

#include "common/error.hpp"
#include "frontend/frontend.hpp"

namespace {

// Distance [m] from (x, 0, 0) along (dx, dy, dz) to the nearest surface: the ground at -1.7 m, house fronts
// at 12 and -9 m, a wall across the end at 60 m, and walls between the front gardens, every 6 m.
double cast(double x, double dx, double dy, double dz) {
  double nearest = std::numeric_limits<double>::infinity();
  const auto hit = [&nearest](double t) {
    if (t > 0.5 && t < nearest) nearest = t;
  };
  hit(-1.7 / dz);
  hit((dy > 0 ? 12.0 : -9.0) / dy);
  hit((60.0 - x) / dx);
  for (int k = -5; k < 9; ++k) {
    const double t = (6.0 * k - x) / dx, y = std::abs(t * dy);
    if (y > 6.0 && y < 9.5 && t * dz < 3.0) hit(t);
  }
  return nearest;
}

// One sweep of 32 beams from x metres along the street. The sensor stands still in the sweep.
hp2::Scan make_scan(int index, double x) {
  hp2::Scan scan;
  scan.sequence = index;
  scan.utime = 100000LL * index;
  for (int beam = 0; beam < 32; ++beam) {
    for (int column = 0; column < 512; ++column) {
      const double azimuth = 2.0 * M_PI * column / 512.0, elevation = (-16.0 + beam) * M_PI / 180.0 + 0.001;
      const double d[3] = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                           std::sin(elevation)};
      const double range = cast(x, d[0], d[1], d[2]);
      if (range > 50.0) continue;
      scan.x.push_back(static_cast<float>(range * d[0]));
      scan.y.push_back(static_cast<float>(range * d[1]));
      scan.z.push_back(static_cast<float>(range * d[2]));
    }
  }
  return scan;
}

}  // namespace

int main() try {
  hp2::FrontendConfig config;  // the defaults; see frontend_config.hpp
  config.deskew = false;       // the scans of this example are not distorted
  hp2::Frontend frontend(config, 2);
  double error = 0.0;
  for (int i = 0; i < 30; ++i) {
    const double x = 0.3 * i;
    const hp2::FrontendOutput out = frontend.process(make_scan(i, x));
    const Eigen::Vector3d& position = out.odometry.odom_from_sensor.translation;
    error = (position - Eigen::Vector3d(x, 0, 0)).norm();
    std::printf("scan %2d at %6.3f %6.3f %6.3f, truth %6.3f\n", i, position.x(), position.y(), position.z(),
                x);
  }
  std::printf("error of the last position: %.3f m\n", error);
  return error < 0.1 ? 0 : 1;
} catch (const hp2::Error& e) {
  std::fprintf(stderr, "%s\n", e.what());
  return 1;
}
