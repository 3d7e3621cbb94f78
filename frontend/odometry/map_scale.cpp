#include "frontend/odometry/map_scale.hpp"

#include <algorithm>
#include <cmath>

#include <tsl/robin_set.h>

#include "common/registration/voxel_key.hpp"

namespace hp2 {

void MapScale::add(const Scan& scan, double min_range_m, double max_range_m, double mean_range_m) {
  if (!(growth_ > 0.0) || ++scans_ >= config_.every) {
    scans_ = 0;
    add_growth(surface_growth(scan, config_.smallest_m, min_range_m, max_range_m));
  }
  settle(mean_range_m);
}

void MapScale::add_growth(double growth) {
  if (!(growth > 0.0)) return;
  growth_ = growth_ > 0.0 ? config_.memory * growth_ + (1.0 - config_.memory) * growth : growth;
}

void MapScale::settle(double mean_range_m) {
  if (!(growth_ > 0.0)) return;
  const double share = std::clamp((growth_ - config_.lines) / (config_.surface - config_.lines), 0.0, 1.0);
  const double by_growth = config_.largest_m - share * (config_.largest_m - config_.smallest_m);
  const double wanted = std::min(by_growth, std::max(config_.least_m, config_.range_share * mean_range_m));
  const bool differs = wanted > config_.hysteresis * voxel_m_ || voxel_m_ > config_.hysteresis * wanted;
  if (differs) voxel_m_ = wanted;
}

void MapScale::save(ByteWriter& out) const {
  out.put(scans_);
  out.put(growth_);
  out.put(voxel_m_);
}

void MapScale::load(ByteReader& in) {
  scans_ = in.take<int>();
  growth_ = in.take<double>();
  voxel_m_ = in.take<double>();
  const bool growth = growth_ >= 0.0 && growth_ < 1e6 && scans_ >= 0 && scans_ <= config_.every;
  const bool voxel = voxel_m_ == 0.0 || (voxel_m_ >= config_.least_m && voxel_m_ <= config_.largest_m);
  if (!growth || !voxel) in.fail("map scale");
}

double surface_growth(const Scan& scan, double voxel_m, double min_range_m, double max_range_m) {
  const auto min2 = static_cast<float>(min_range_m * min_range_m),
             max2 = static_cast<float>(max_range_m * max_range_m);
  const auto inverse = static_cast<float>(1.0 / voxel_m);
  tsl::robin_set<std::uint64_t, VoxelKeyHash> fine, coarse;
  std::uint64_t last = 0;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3f p(scan.x[i], scan.y[i], scan.z[i]);
    const float r2 = p.squaredNorm();
    if (!(r2 >= min2 && r2 <= max2)) continue;
    const Voxel3i v = (p * inverse).array().floor().cast<int>();
    const std::uint64_t key = voxel_key(v);
    if (!fine.empty() && key == last) continue;
    last = key;
    if (fine.insert(key).second) coarse.insert(voxel_key({v.x() >> 1, v.y() >> 1, v.z() >> 1}));
  }
  return coarse.empty() ? 0.0 : static_cast<double>(fine.size()) / static_cast<double>(coarse.size());
}

}  // namespace hp2
