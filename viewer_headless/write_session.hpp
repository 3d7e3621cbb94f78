// Everything that the viewer leaves in its output folder, from one SessionView.
#pragma once
#include <string>
#include <vector>

#include "common/config.hpp"
#include "viewer_headless/session_view.hpp"

namespace hp2 {

/// Settings of the viewer. Keys of the YAML section "viewer".
struct ViewerConfig {
  double map_voxel_m = 0.5;    ///< Edge of the map's voxels, one point each [m]; 0: every stored point.
  int picture_size_px = 2000;  ///< Long side of the pictures.
  int report_points = 2000;    ///< Points a curve in the report; longer drives are thinned out.
};
/// The section "viewer" bound to `config`.
ConfigSection viewer_section(ViewerConfig& config);

/// Which files to write; poses, closures.csv, graph.g2o and summary.json always are. The map takes the most
/// time.
struct WriteOptions {
  bool map = true;     ///< map.ply, map.pcd, map_topdown.png
  bool report = true;  ///< trajectory.png, report.html
};

/// Writes poses_kitti.txt, poses_tum.txt, poses_odometry_kitti.txt, poses_odometry_tum.txt, map.ply, map.pcd,
/// trajectory.png, map_topdown.png, graph.g2o, closures.csv, summary.json and report.html into `folder`,
/// which is created if it is missing. Each file is replaced whole or not at all. The same view gives the same
/// bytes, except that elapsed times differ.
/// @return names of the files written
/// @throws Error naming the file that cannot be written, or what view.read_submap throws
std::vector<std::string> write_session(const SessionView& view, const std::string& folder,
                                       const ViewerConfig& config, const WriteOptions& options = {});

/// Creates the output folder and makes sure that files can be made in it; to be called before a long run.
/// @throws Error if it cannot be created or written
void prepare_output_folder(const std::string& folder);

}  // namespace hp2
