// All settings of the back-end, with their defaults. Keys of the YAML section "backend".
#pragma once
#include <string>

#include "common/config.hpp"

namespace hp2 {

/// Settings of the back-end. Where the paper (or the work it builds on) names a value, that is the default.
struct BackendConfig {
  bool loop_closing = true;
  std::string candidates = "adaptive";  ///< Which submaps may close a loop: "adaptive" or "paper".
  int skip_newest = 3;                  ///< "paper": so many submaps before the new one are no candidates.
  double cell_size_m = 0.5;             ///< Of the density image.
  double density_cut = 0.05;            ///< Cells below this share of the densest are empty.
  int features = 500;                   ///< ORB features an image.
  int fast_threshold = 35;
  int self_similar_bits = 35;  ///< Descriptors as near as this to another one of their image are left out.
  int match_bits = 50;         ///< Largest Hamming distance of a match.
  double ransac_cells = 3.0;   ///< Inlier distance of the 2D alignment [cells].
  int ransac_inliers = 5;      ///< Fewest inliers of the 2D alignment.
  double min_overlap = 0.4;    ///< Smallest overlap of the submaps' 0.5 m voxels after the 3D registration.
  int candidates_per_submap = 4;  ///< Most candidates a submap that are verified in 3D.
  double max_drift = 0.05;  ///< Odometry drift beyond which a closure is not believed, share of the path.
  bool smooth_scans =
      true;  ///< At the end of a session, weigh the scans' noise against the sensor's inertia.
  bool graph_candidates =
      true;  ///< Propose pairs that the graph says overlap, not only those that look alike.
};

/// The section "backend" bound to `config`.
ConfigSection backend_section(BackendConfig& config);

}  // namespace hp2
