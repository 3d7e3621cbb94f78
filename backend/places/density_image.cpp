#include "backend/places/density_image.hpp"

#include <algorithm>
#include <cmath>

#include <climits>

#include "common/registration/voxel_key.hpp"

namespace hp2 {
namespace {

constexpr float kMaxExtent = 250.0F;  // [m]: bounds the image, whatever a submap claims

}  // namespace

DensityImage make_density_image(const std::vector<Eigen::Vector3f>& points, const Pose& ground_from_submap,
                                double cell_m, double cut) {
  DensityImage image;
  image.cell_m = cell_m;
  const Eigen::Matrix<float, 2, 3> r =
      ground_from_submap.rotation.toRotationMatrix().cast<float>().topRows<2>();
  const Eigen::Vector2f t = ground_from_submap.translation.head<2>().cast<float>();
  std::vector<Eigen::Vector2i> cells;
  cells.reserve(points.size());
  Eigen::Vector2i low(INT_MAX, INT_MAX), high(INT_MIN, INT_MIN);
  for (const auto& p : points) {
    const Eigen::Vector2f q = r * p + t;
    if (!(q.cwiseAbs().maxCoeff() < kMaxExtent) || !p.allFinite()) continue;
    const Eigen::Vector2f c = q / static_cast<float>(cell_m);
    const Eigen::Vector2i cell(floor_to_int(c.x()), floor_to_int(c.y()));
    cells.push_back(cell);
    low = low.cwiseMin(cell);
    high = high.cwiseMax(cell);
  }
  if (cells.empty()) return image;

  image.width = high.x() - low.x() + 1;
  image.height = high.y() - low.y() + 1;
  image.min_m = low.cast<double>() * cell_m;
  std::vector<std::uint32_t> counts(static_cast<std::size_t>(image.width) * image.height, 0);
  for (const auto& c : cells)
    ++counts[static_cast<std::size_t>(c.y() - low.y()) * image.width + (c.x() - low.x())];

  std::vector<std::uint32_t> occupied;
  for (const auto c : counts) {
    if (c > 0) occupied.push_back(c);
  }
  const auto rank = static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(occupied.size() - 1));
  std::nth_element(occupied.begin(), occupied.begin() + rank, occupied.end());
  const double densest = occupied[static_cast<std::size_t>(rank)];
  image.pixels.resize(counts.size());
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] == 0) continue;  // nearly all of them
    const double share = std::min(counts[i] / densest, 1.0);
    image.pixels[i] = share < cut ? 0 : static_cast<std::uint8_t>(std::lround(255.0 * share));
  }
  return image;
}

}  // namespace hp2
