// The part of an iteration that runs for every source point: nearest map point, planarity of the map there,
// and the terms of the normal equations.
#include <algorithm>
#include <cmath>

#include "common/registration/hybrid_icp.hpp"
#include "common/registration/stopwatch.hpp"

namespace hp2 {
namespace {

// Source points per block; fixed, so that sums do not depend on the number of threads.
constexpr std::size_t kBlock = PlaneBatch::kMost;

// IRLS weight of the Geman-McClure loss rho(e) = e^2 / (e^2 + c^2), up to the constant factor 2, times
// c^2 / sigma^2: whatever c is, a residual of zero weighs 1 / sigma^2.
float robust_weight(float squared_error, float c2, float per_sigma2) {
  const float d = c2 / (squared_error + c2);
  return d * d * per_sigma2;
}

constexpr std::size_t kAhead = 6;   // queries to prefetch ahead
constexpr float kEmptyMove = 0.2F;  // of a voxel
constexpr float kFar = 50.0F;       // [m]: seen from there, a non-planar point weighs half when refining

// A line has many normals. Where a sensor draws single lines, such as a ring on the ground ahead, the normal
// may lie flat. It would then hold the sensor to its own scan pattern, which moves with it. A line at one
// elevation for the sensor is such a ring, or cannot be distinguished from one.
bool is_scan_line(const Eigen::Vector3f& line, const Eigen::Vector3f& to_sensor,
                  const Eigen::Vector3f& sensor_axis) {
  constexpr float kLevel = 0.3F;  // sine of the angle to the line of one elevation
  const Eigen::Vector3f view = to_sensor.normalized();
  const Eigen::Vector3f upwards = sensor_axis - sensor_axis.dot(view) * view;  // across the view
  return std::abs(line.dot(upwards)) < kLevel * upwards.norm();
}

}  // namespace

void HybridIcp::search(const LocalMap& map, const Selection& source, const Pose& local_from_source,
                       Part& part) {
  const Eigen::Matrix3f r = local_from_source.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = local_from_source.translation.cast<float>();
  const auto edge = static_cast<float>(map.voxel_size_m());
  const float inverse_edge = 1.0F / edge;
  part.fresh.clear();
  part.probes.clear();
  LocalMap::Cursor cursor;
  for (std::size_t i = source.begin; i < source.end; i += source.stride) {
    Correspondence& c = correspondences_[i];
    const Eigen::Vector3f p = r * source.points[i] + t;
    if (c.other_distance >= 0.0F) {
      // The last neighbour stays valid while no other point can have become nearer. "No neighbour" stays
      // valid until the point has moved by a part of a voxel.
      const float moved = (p - c.searched_at).norm();
      if (c.voxel < 0 && moved < kEmptyMove * edge) continue;
      const float distance = c.voxel >= 0 ? (p - c.target).norm() : c.other_distance;
      if (distance <= c.other_distance - moved) continue;
    }
    c.searched_at = p;
    part.fresh.push_back(static_cast<std::uint32_t>(i));
    part.probes.push_back(map.probe(locate_near(p, origin_, edge, inverse_edge), cursor));
  }
  const std::size_t n = part.probes.size();
  for (std::size_t k = 0; k < std::min(kAhead, n); ++k) map.look_around(part.probes[k]);
  std::size_t found = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (k + kAhead < n) map.look_around(part.probes[k + kAhead]);
    const LocalMap::Probe& probe = part.probes[k];
    Correspondence& c = correspondences_[part.fresh[k]];
    const NearestPoint nearest = map.nearest(probe, margin_m_);
    c.other_distance = nearest.other_distance_m;
    c.voxel = nearest.voxel;
    c.turned = c.hidden = c.line = c.scan_line = false;
    if (nearest.voxel < 0) continue;
    c.slot = static_cast<std::int16_t>(nearest.slot);
    map.prefetch_views(nearest.voxel);
    c.target = c.searched_at - probe.at.offset + nearest.offset;
    part.fresh[found++] = part.fresh[k];
  }
  part.fresh.resize(found);
}

// The map's planarity, or one computed here where that is stale. Consecutive points often need the same
// voxel.
const Planarity& HybridIcp::shape_of(const LocalMap& map, std::int32_t voxel, Part& part) {
  if (!map.planarity_stale(voxel)) return map.planarity(voxel);
  std::uint32_t& recent = part.recent[static_cast<std::uint32_t>(voxel) % part.recent.size()];
  if (recent >= part.planarities.size() || part.planarities[recent].first != voxel) {
    recent = static_cast<std::uint32_t>(part.planarities.size());
    part.planarities.emplace_back(voxel, map.shape(voxel));
  }
  return part.planarities[recent].second;
}

// A thin object ahead (a post, a sign, a railing) is seen from behind once the sensor has passed it. That is
// another surface. Matched with the front, it would hold the sensor back by the object's thickness each time.
void HybridIcp::look_on_this_side(const LocalMap& map, const Eigen::Vector3f& sensor,
                                  Correspondence& c) const {
  constexpr float kFarther = 0.3F;  // [m], than the nearest point
  const Eigen::Vector3f view = (sensor - c.searched_at).normalized();
  c.turned = LocalMap::other_side(c.normal, map.view(c.voxel, c.slot), view);
  if (!c.turned) return;
  const Eigen::Vector3f corner =
      static_cast<float>(map.voxel_size_m()) * (map.voxel_coordinates(c.voxel) - origin_).cast<float>();
  const NearestPoint other = map.nearest_on_side(c.searched_at - corner, c.voxel, c.normal, view,
                                                 (c.searched_at - c.target).norm() + kFarther);
  c.hidden = other.voxel < 0;
  if (c.hidden) return;
  c.target = corner + other.offset;
  c.other_distance = 0.0F;  // not valid once the point moves
}

void HybridIcp::turned_points(const IcpResult& result,
                              std::vector<std::pair<std::uint32_t, Eigen::Vector3f>>& out) const {
  out.clear();
  const Pose& pose = result.map_from_source;
  if (pose.translation != outcome_.translation || pose.rotation.coeffs() != outcome_.rotation.coeffs())
    return;
  for (std::size_t i = 0; i < correspondences_.size(); ++i) {
    const Correspondence& c = correspondences_[i];
    if (c.voxel >= 0 && c.turned) out.emplace_back(static_cast<std::uint32_t>(i), c.normal);
  }
}

void HybridIcp::classify(const LocalMap& map, const Pose& local_from_source, Part& part) {
  part.planarities.clear();
  const Eigen::Vector3f sensor = local_from_source.translation.cast<float>();
  const Eigen::Vector3f axis = (local_from_source.rotation * Eigen::Vector3d::UnitZ()).cast<float>();
  const auto n_min = static_cast<float>(config_.n_min);
  for (const std::uint32_t i : part.fresh) {
    Correspondence& c = correspondences_[i];
    c.normal.setZero();
    c.seen_from_m = map.view_distance_m(c.voxel, c.slot);
    if (config_.mode == IcpMode::kPointToPoint) continue;
    const Planarity& shape = shape_of(map, c.voxel, part);
    if (shape.n < n_min) continue;
    double tau = 1.0;
    if (config_.mode == IcpMode::kFixedThreshold) {
      tau = config_.tau_ref;
    } else if (config_.mode != IcpMode::kPointToPlane) {
      tau = adaptive_threshold(static_cast<double>(shape.n), config_.tau_ref, config_.n_ref, config_.tau_min,
                               config_.tau_max);
    }
    if (!(static_cast<double>(shape.score) < tau)) continue;
    c.normal = shape.normal;
    c.line = config_.scan_lines && shape.line != Eigen::Vector3f::Zero();
    const bool drawn_by_a_sensor = c.line && c.seen_from_m > 0.0F;
    c.scan_line = drawn_by_a_sensor && is_scan_line(shape.line, sensor - c.searched_at, axis);
    if (config_.two_sides) look_on_this_side(map, sensor, c);
  }
}

void HybridIcp::accumulate(const Selection& source, const Pose& local_from_source, double sigma_m,
                           Part& part) const {
  const Eigen::Matrix3f r = local_from_source.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = local_from_source.translation.cast<float>();
  const auto sigma2 = static_cast<float>(sigma_m * sigma_m);
  const float max2 = 9.0F * sigma2, per_sigma2 = 1.0F / sigma2;
  const auto planar2 = static_cast<float>(scales_.planar_m * scales_.planar_m);
  const auto point2 = static_cast<float>(scales_.point_m * scales_.point_m);
  const bool plane_only = config_.mode == IcpMode::kPointToPlane;
  NormalEquations& sums = part.sums;
  sums = NormalEquations();
  PlaneBatch planes;
  PointBatch points, plane_points;
  float fit = 0.0F;
  for (std::size_t i = source.begin; i < source.end; i += source.stride) {
    const Correspondence& c = correspondences_[i];
    if (c.voxel < 0 || c.hidden || (refining_ && c.line)) continue;
    const Eigen::Vector3f p = r * source.points[i] + t;
    const Eigen::Vector3f d = p - c.target;
    const float squared = d.squaredNorm();
    if (squared > max2) continue;
    fit += fit2_ / (fit2_ + squared);
    const Eigen::Vector3f& n = c.normal;
    if (n != Eigen::Vector3f::Zero()) {
      const float e = n.dot(d);
      if (!c.scan_line || accelerated_) {
        planes.add({p.x(), p.y(), p.z(), n.x(), n.y(), n.z(), e, robust_weight(e * e, planar2, per_sigma2)});
      }
      if (in_plane_needed_) {
        plane_points.add(
            {p.x(), p.y(), p.z(), d.x(), d.y(), d.z(), robust_weight(squared, sigma2, per_sigma2)});
      }
    } else if (!plane_only) {
      // Points seen from far have the errors of that scan's bearing and of the gaps between its rays.
      const float far = refining_ ? c.seen_from_m / kFar : 0.0F;
      points.add({p.x(), p.y(), p.z(), d.x(), d.y(), d.z(),
                  robust_weight(squared, point2, per_sigma2) / (1.0F + far * far)});
    }
  }
  sums.fit = static_cast<double>(fit);
  planes.flush(sums.planar);
  points.flush(sums.non_planar);
  if (in_plane_needed_) plane_points.flush(sums.planar_points);
}

// Correspondences and their sums in one pass over the points, block by block while they are in the cache.
NormalEquations HybridIcp::linearise(LocalMap& map, const std::vector<Eigen::Vector3f>& source,
                                     std::size_t stride, const Pose& local_from_source, double sigma_m,
                                     const Parallel& parallel, IcpResult& result) {
  Stopwatch whole;
  const std::size_t span = kBlock * stride;
  const std::size_t parts = Parallel::block_count(source.size(), span);
  if (parts_.size() < parts) parts_.resize(parts);
  parallel.for_blocks(source.size(), span, [&](std::size_t block, std::size_t begin, std::size_t end) {
    Part& part = parts_[block];
    const Selection selection{source, stride, begin, end};
    Stopwatch watch;
    search(map, selection, local_from_source, part);
    part.ms[0] = watch.lap_ms();
    classify(map, local_from_source, part);
    part.ms[1] = watch.lap_ms();
    accumulate(selection, local_from_source, sigma_m, part);
    part.ms[2] = watch.lap_ms();
  });
  NormalEquations total;
  double ms[3] = {};
  for (std::size_t b = 0; b < parts; ++b) {
    const Part& part = parts_[b];
    total.add(part.sums);
    for (const auto& [voxel, planarity] : part.planarities) map.set_planarity(voxel, planarity);
    for (int k = 0; k < 3; ++k) ms[k] += part.ms[k];
  }
  // The threads' times, scaled to what the whole has taken.
  const double scale = whole.lap_ms() / std::max(1e-9, ms[0] + ms[1] + ms[2]);
  result.ms_search += scale * ms[0];
  result.ms_planarity += scale * ms[1];
  result.ms_solve += scale * ms[2];
  return total;
}

double HybridIcp::agreement(LocalMap& map, const std::vector<Eigen::Vector3f>& source,
                            const Pose& map_from_source, const Parallel& parallel) {
  constexpr std::size_t kPoints = 1500;
  constexpr double kReach = 1.0;  // [m]
  constexpr float kScale2 = 0.2F * 0.2F;
  if (map.empty() || source.empty()) return 0.0;
  const std::size_t stride = (source.size() + kPoints - 1) / kPoints;
  origin_ = map.locate(map_from_source.translation).voxel;
  const Eigen::Vector3d origin = origin_.cast<double>() * map.voxel_size_m();
  const Pose local(map_from_source.rotation, map_from_source.translation - origin);
  correspondences_.assign(source.size(), Correspondence());
  scales_ = {kReach / 3.0, kReach / 3.0};
  refining_ = false;
  IcpResult ignored;
  linearise(map, source, stride, local, kReach / 3.0, parallel, ignored);
  const Eigen::Matrix3f r = local.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = local.translation.cast<float>();
  double sum = 0.0;
  std::size_t asked = 0;
  for (std::size_t i = 0; i < source.size(); ++i) {
    const Correspondence& c = correspondences_[i];
    if (c.other_distance < 0.0F) continue;
    ++asked;
    if (c.voxel < 0) continue;
    const Eigen::Vector3f d = r * source[i] + t - c.target;
    const float squared = d.squaredNorm(), e = c.normal.dot(d);
    if (squared > static_cast<float>(kReach * kReach)) continue;
    sum += static_cast<double>(kScale2 / (kScale2 + (c.normal != Eigen::Vector3f::Zero() ? e * e : squared)));
  }
  return asked > 0 ? sum / static_cast<double>(asked) : 0.0;
}

}  // namespace hp2
