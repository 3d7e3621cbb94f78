#include "frontend/frontend_config.hpp"

#include "common/error.hpp"

namespace hp2 {

const std::vector<std::string>& frontend_modes() {
  static const std::vector<std::string> modes{"hybrid",      "point_to_point",  "point_to_plane",
                                              "fixed_alpha", "fixed_threshold", "robust"};
  return modes;
}

ConfigSection frontend_section(FrontendConfig& c) {
  ConfigSection s("frontend");
  s.add("mode", c.mode, "Residuals: the paper's hybrid, one of its ablations, or our robust balance",
        frontend_modes());
  s.add("min_range_m", c.min_range_m, "Points nearer to the sensor are left out [m]", 0.0, 1000.0);
  s.add("max_range_m", c.max_range_m,
        "Points farther away are left out; also the local map's radius and r_max [m]", 1.0, 1000.0);
  s.add("deskew", c.deskew, "Undo the sensor's motion in the sweep where the points have times");
  s.add("redeskew_passes", c.redeskew_passes,
        "Registrations after the first, with the points deskewed by its result", 0, 10);
  s.add("redeskew_threshold_m", c.redeskew_threshold_m,
        "They are done where the motion in the sweep differs from the predicted by more than this [m]", 0.0,
        100.0);
  s.add("redeskew_gain", c.redeskew_gain,
        "Share of the difference that they correct in the first scans; later ones are filtered", 0.0, 1.0);
  s.add("voxel_size_m", c.voxel_size_m,
        "Edge of a local map voxel [m], at least 0.2; 0: 0.2 to 0.8, by how densely and how far the sensor "
        "sees",
        0.0, 10.0);
  s.add("max_points_per_voxel", c.max_points_per_voxel, "Points that a voxel keeps", 1, 255);
  s.add("min_spacing_m", c.min_spacing_m,
        "Points of a voxel are at least this far apart [m]; 0: 0.375 voxel_size_m", 0.0, 10.0);
  s.add("map_point_voxel_m", c.map_point_voxel_m,
        "One point per voxel of this edge of each scan goes to the map [m]; 0: 0.375 voxel_size_m", 0.0,
        10.0);
  s.add("source_voxel_m", c.source_voxel_m,
        "Of these one per voxel of this edge is registered [m]; 0: 0.875 voxel_size_m", 0.0, 10.0);
  s.add("tau_ref", c.tau_ref, "Planarity threshold at a neighbourhood of n_ref points", 1e-6, 1.0);
  s.add("n_ref", c.n_ref, "Neighbourhood size that tau_ref holds for", 1.0, 1e6);
  s.add("tau_min", c.tau_min, "Lower bound of tau(n)", 0.0, 1.0);
  s.add("tau_max", c.tau_max, "Upper bound of tau(n)", 0.0, 1.0);
  s.add("n_min", c.n_min, "Fewest points of a neighbourhood that can be planar", 3, 1000);
  s.add("max_iterations", c.max_iterations, "Most Gauss-Newton iterations a scan", 1, 1000);
  s.add("convergence_m", c.convergence_m,
        "A step shorter than this [m, rad], in mode point_to_point than a third of it, ends the iterations",
        1e-9, 1.0);
  s.add("weak_direction_ratio", c.weak_direction_ratio,
        "Mode robust: directions whose eigenvalue is below this share of the largest are supported", 0.0,
        1.0);
  s.add("coarse_step_m", c.coarse_step_m,
        "While steps are longer than this [m, rad] some 800 points are registered; 0: always all", 0.0, 1.0);
  s.add("in_plane_weight", c.in_plane_weight,
        "Mode robust: weight of planar correspondences' in-plane residual", 0.0, 10.0);
  s.add("min_eigenvalue_ratio", c.min_eigenvalue_ratio,
        "A direction with less than this share of the largest eigenvalue of the information is not observed",
        0.0, 1.0);
  s.add("initial_sigma_m", c.initial_sigma_m, "sigma until the sensor has moved [m]", 0.01, 100.0);
  s.add("min_sigma_m", c.min_sigma_m, "sigma never falls below this [m]", 0.001, 10.0);
  s.add("max_sigma_m", c.max_sigma_m,
        "sigma never rises above this [m]; where predictions are worse, mode robust registers from other "
        "guesses as well",
        0.01, 1000.0);
  s.add("max_sigma_share", c.max_sigma_share,
        "Mode robust: nor above this share of the mean range of the scan's points", 0.01, 1000.0);
  s.add("sigma_window", c.sigma_window, "Motion errors that sigma is the RMS of", 1, 100000);
  s.add("submap_length_m", c.submap_length_m,
        "Travel after which a submap is cut, beta [m]; the paper's is 100; 0: 25, or 15 where the sensor "
        "sees less than 12 m",
        0.0, 10000.0);
  s.add("submap_voxel_m", c.submap_voxel_m, "One point a voxel of this edge in a submap [m]", 0.05, 10.0);
  s.add("late_scan_ratio", c.late_scan_ratio,
        "An interval so much longer than the one before has scans missing in it", 1.0, 100.0);
  s.add("degenerate_m", c.degenerate_m,
        "State degenerate where a weakly observed direction's deviation in a scan is above this [m]", 0.0,
        100.0);
  s.add("incredible_surprise", c.incredible_surprise,
        "State degenerate where a step's squared error is so many times what was expected of it", 1.0, 1e9);
  s.add("doubtful_speed", c.doubtful_speed,
        "Factor on the covariance of degenerate first scans, whose speed may be wrong", 1.0, 1e6);
  const auto part = [&](const char* name, bool& value, const char* text) { s.add(name, value, text); };
  RobustConfig& r = c.robust;
  part("robust.map_scale", r.map_scale, "Mode robust: map voxels follow what is seen");
  part("robust.wide_neighbourhoods", r.wide_neighbourhoods,
       "Mode robust: neighbourhoods of few points, or of a line, grow to 125 voxels");
  part("robust.weak_directions", r.weak_directions,
       "Mode robust: in-plane residuals support weakly observed directions");
  part("robust.two_sides", r.two_sides, "Mode robust: front and back of thin things are kept apart");
  part("robust.scan_lines", r.scan_lines, "Mode robust: lines that the sensor may have drawn have no normal");
  part("robust.refinement", r.refinement,
       "Mode robust: last registration with a loss as narrow as the residuals");
  part("robust.motion_filter", r.motion_filter, "Mode robust: filtered velocities, deskewing again");
  part("robust.guesses", r.guesses, "Mode robust: other guesses where predictions are far off");
  part("robust.dropped_scans", r.dropped_scans,
       "Mode robust: a scan behind missing ones stays out of the map");
  part("robust.start_search", r.start_search, "Mode robust: the speed of the first scans is searched");
  part("robust.covariance_terms", r.covariance_terms,
       "Mode robust: covariance grows with what deskewing leaves and with surprises");
  return s;
}

RobustConfig robust_parts(const FrontendConfig& c) {
  if (c.mode == "robust") return c.robust;
  return {false, false, false, false, false, false, false, false, false, false, false};
}

MapSizes map_sizes(const FrontendConfig& c, double voxel_m) {
  constexpr double kSpacing = 0.375, kSource = 0.875;  // of the voxel
  const auto given = [](double size, double otherwise) { return size > 0.0 ? size : otherwise; };
  MapSizes s;
  s.voxel_m = given(c.voxel_size_m, voxel_m);
  s.spacing_m = given(c.min_spacing_m, kSpacing * s.voxel_m);
  s.map_point_m = given(c.map_point_voxel_m, kSpacing * s.voxel_m);
  s.source_voxel_m = given(c.source_voxel_m, kSource * s.voxel_m);
  return s;
}

void validate(const FrontendConfig& c) {
  validate(c.sensor);
  if (c.min_range_m >= c.max_range_m) {
    throw Error("min_range_m is not below max_range_m", "configuration, section \"frontend\"",
                "Raise max_range_m or lower min_range_m.");
  }
  // A correspondence is sought in the voxels around a point: with smaller ones it stays with the sensor.
  constexpr double kSmallestVoxel_m = 0.2;
  if (c.voxel_size_m > 0.0 && c.voxel_size_m < kSmallestVoxel_m) {
    throw Error(
        "voxel_size_m is below 0.2 m", "configuration, section \"frontend\"",
        "Give 0.2 or more, or 0 for a size that follows the scene: motion between scans is not found in "
        "smaller voxels.");
  }
  if (c.min_sigma_m > c.max_sigma_m) {
    throw Error("min_sigma_m is above max_sigma_m", "configuration, section \"frontend\"", "Swap them.");
  }
  if (c.tau_min > c.tau_max) {
    throw Error("tau_min is above tau_max", "configuration, section \"frontend\"", "Swap them.");
  }
}

}  // namespace hp2
