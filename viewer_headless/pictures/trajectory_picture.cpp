#include <cstdio>
#include <limits>

#include "common/drawing/chart.hpp"
#include "viewer_headless/pictures/pictures.hpp"

namespace hp2 {

std::string draw_trajectory(const SessionDigest& digest, const std::vector<ClosureRecord>& closures,
                            const std::optional<GroundTruthComparison>& truth, int width_px) {
  Chart chart;
  chart.title = "Trajectory";
  chart.x_label = "x [m]";
  chart.y_label = "y [m]";
  chart.equal_aspect = true;
  chart.width_px = width_px;
  chart.height_px = width_px;

  Links links{"accepted closures", hex_color("cc79a7"), {}, 2.0};
  const auto count = static_cast<std::int64_t>(digest.map_from_submap.size());
  for (const ClosureRecord& c : closures) {
    if (!c.accepted || c.from_submap < 0 || c.to_submap < 0 || c.from_submap >= count || c.to_submap >= count)
      continue;
    const auto at = [&](std::int64_t id) -> Eigen::Vector2d {
      return digest.map_from_submap[static_cast<std::size_t>(id)].translation.head<2>();
    };
    links.lines.emplace_back(at(c.from_submap), at(c.to_submap));
  }
  char text[160];
  std::snprintf(text, sizeof text, "%zu scans, %.0f m, %zu submaps, %zu closures", digest.scans.size(),
                digest.path_m, digest.map_from_submap.size(), links.lines.size());
  chart.subtitle = text;
  links.name += " (" + std::to_string(links.lines.size()) + ")";

  Curve odometry{"odometry (before)", hex_color("e69f00"), {}, 2.0, 9.0};
  Curve corrected{"final (after)", hex_color("0072b2"), {}, 3.0};
  corrected.start_and_end = true;
  const std::vector<std::size_t> gaps = digest.gaps();
  auto gap = gaps.begin();
  for (std::size_t i = 0; i < digest.scans.size(); ++i) {
    const ScanRecord& scan = digest.scans[i];
    if (gap != gaps.end() && *gap == i) {  // the line breaks
      ++gap;
      constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
      odometry.points.emplace_back(kNan, kNan);
      corrected.points.emplace_back(kNan, kNan);
    }
    odometry.points.emplace_back(scan.odom_from_sensor.translation.head<2>());
    corrected.points.emplace_back(scan.map_from_sensor.translation.head<2>());
  }
  if (truth) {
    const auto named = [&](Curve& curve, const char* name, double rmse) {
      std::snprintf(text, sizeof text, "%s, ATE %.3f m", name, rmse);
      curve.name = text;
    };
    named(odometry, "odometry (before)", truth->odometry.ate.rmse);
    named(corrected, "final (after)", truth->corrected.ate.rmse);
    Curve reference{"ground truth", {130, 136, 142}, {}, 6.0};
    const Trajectory in_map = transformed(truth->map_from_truth, truth->corrected.reference);
    for (const auto& pose : in_map.poses) reference.points.emplace_back(pose(0, 3), pose(1, 3));
    chart.curves.push_back(reference);
  }
  chart.curves.push_back(odometry);
  chart.curves.push_back(corrected);
  chart.links.push_back(links);
  return draw_chart(chart, ImageFormat::kPng);
}

}  // namespace hp2
