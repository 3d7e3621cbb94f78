#include "backend/backend_config.hpp"

namespace hp2 {

ConfigSection backend_section(BackendConfig& c) {
  ConfigSection s("backend");
  s.add("loop_closing", c.loop_closing, "close loops; false: as if no place was ever seen again");
  s.add("candidates", c.candidates,
        "which submaps may close a loop: adaptive (by what was travelled and seen) or paper (all but the "
        "newest few)",
        {"adaptive", "paper"});
  s.add("skip_newest", c.skip_newest,
        "with candidates: paper, so many submaps before the new one are left out", 1, 1000);
  s.add("cell_size_m", c.cell_size_m, "cell of the bird's-eye density image [m]", 0.05, 5.0);
  s.add("density_cut", c.density_cut, "cells of less than this share of the densest are emptied", 0.0, 1.0);
  s.add("features", c.features, "ORB features a density image", 10, 10000);
  s.add("fast_threshold", c.fast_threshold, "FAST corner threshold", 1, 255);
  s.add("self_similar_bits", c.self_similar_bits,
        "descriptors as near as this to another one of the same image are left out [bits]", 0, 256);
  s.add("match_bits", c.match_bits, "largest Hamming distance of a match [bits]", 0, 256);
  s.add("ransac_cells", c.ransac_cells, "inlier distance of the 2D alignment [cells]", 0.1, 100.0);
  s.add("ransac_inliers", c.ransac_inliers, "fewest inliers of the 2D alignment", 3, 1000);
  s.add("min_overlap", c.min_overlap, "smallest overlap of the 0.5 m voxels of two submaps that close a loop",
        0.0, 1.0);
  s.add("candidates_per_submap", c.candidates_per_submap, "most candidates a submap that are verified in 3D",
        1, 1000);
  s.add("max_drift", c.max_drift, "odometry drift beyond which a closure is not believed, share of the path",
        0.001, 10.0);
  s.add("graph_candidates", c.graph_candidates, "also try pairs that the graph says overlap");
  s.add("smooth_scans", c.smooth_scans,
        "at the end of a session, move every scan's pose to where a sensor with inertia was likeliest");
  return s;
}

}  // namespace hp2
