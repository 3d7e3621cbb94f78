#include "viewer_headless/write_session.hpp"

#include <algorithm>
#include <filesystem>
#include <memory>

#include "common/atomic_file.hpp"
#include "common/error.hpp"
#include "viewer_headless/ground_truth.hpp"
#include "viewer_headless/map/map_writer.hpp"
#include "viewer_headless/pictures/pictures.hpp"
#include "viewer_headless/pose_files.hpp"
#include "viewer_headless/report/report.hpp"
#include "viewer_headless/session_digest.hpp"
#include "viewer_headless/summary.hpp"

namespace hp2 {

namespace {

// A chart is read at this size; more pixels would only make its text small.
constexpr int kChartSize = 1400;

}  // namespace

ConfigSection viewer_section(ViewerConfig& config) {
  ConfigSection section("viewer");
  section.add("map_voxel_m", config.map_voxel_m,
              "edge of the map's voxels, one point each [m]; 0: every stored point", 0.0, 100.0);
  section.add("picture_size_px", config.picture_size_px, "long side of the pictures [px]", 200, 8000);
  section.add("report_points", config.report_points,
              "points a curve in the report; longer drives are thinned out", 100, 20000);
  return section;
}

void prepare_output_folder(const std::string& folder) {
  std::error_code ec;
  std::filesystem::create_directories(folder, ec);
  if (ec || !std::filesystem::is_directory(folder)) {
    throw Error("the output folder cannot be made" + (ec ? " (" + ec.message() + ")" : std::string()), folder,
                "Choose a folder that you may write to with --out.");
  }
  AtomicFile probe(folder + "/.write_test");  // never committed: it is removed again
}

std::vector<std::string> write_session(const SessionView& view, const std::string& folder,
                                       const ViewerConfig& config, const WriteOptions& options) {
  prepare_output_folder(folder);
  std::vector<std::string> names;
  const auto put = [&](const std::string& name, const std::string& bytes) {
    write_file(folder + "/" + name, bytes);
    names.push_back(name);
  };

  std::unique_ptr<MapWriter> map;
  if (options.map) map = std::make_unique<MapWriter>(folder, config.map_voxel_m);
  const SessionDigest digest =
      digest_session(view, map ? PointSink([&](const Eigen::Vector3d& p) { map->add(p); }) : PointSink());
  const auto truth = compare_with_ground_truth(digest, view.ground_truth);

  put("poses_kitti.txt", poses_kitti(digest));
  put("poses_tum.txt", poses_tum(digest));
  put("poses_odometry_kitti.txt", poses_odometry_kitti(digest));
  put("poses_odometry_tum.txt", poses_odometry_tum(digest));
  put("graph.g2o", graph_g2o(digest, view.graph.closures));
  put("closures.csv", closures_csv(view.graph.closures));
  std::string map_preview;
  if (map) {
    put("map_topdown.png", draw_map(*map, digest, config.map_voxel_m, config.picture_size_px,
                                    options.report ? &map_preview : nullptr));
    map->commit();
    names.insert(names.end(), {"map.ply", "map.pcd"});
  }
  if (options.report) {
    put("trajectory.png",
        draw_trajectory(digest, view.graph.closures, truth, std::min(config.picture_size_px, kChartSize)));
  }
  auto summary = make_summary(view, digest, truth, map ? map->size() : -1);
  summary["warnings"] = remark_texts(make_remarks(view, digest, summary));
  put("summary.json", dump(summary) + "\n");
  if (options.report) {
    put("report.html",
        report_html(report_data(view, digest, truth, summary, config.report_points), map_preview));
  }
  return names;
}

}  // namespace hp2
