// The bird's-eye view of a submap: how much structure stands over each cell of the ground.
#pragma once
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// An image of `height` rows of `width` cells. Cell (column u, row v) covers [min + (u, v) cell, min + (u +
/// 1, v + 1) cell).
struct DensityImage {
  int width = 0, height = 0;
  double cell_m = 0.5;
  Eigen::Vector2d min_m =
      Eigen::Vector2d::Zero();       ///< Corner of cell (0, 0) in the ground-aligned frame [m].
  std::vector<std::uint8_t> pixels;  ///< Row by row; 0: empty, 255: as dense as the densest cells.

  std::uint8_t at(int u, int v) const { return pixels[static_cast<std::size_t>(v) * width + u]; }
};

/// Counts points over each cell, scales so that the 99th percentile of the occupied cells (a single tall pole
/// must not dim the rest) is 255, and empties the cells below `cut`.
/// @param points submap points [m]; not finite ones and those beyond 250 m are left out
/// @param cut    share of the densest, 0..1
DensityImage make_density_image(const std::vector<Eigen::Vector3f>& points, const Pose& ground_from_submap,
                                double cell_m, double cut);

}  // namespace hp2
