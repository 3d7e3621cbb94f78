#include "backend/graph/pieces.hpp"

#include <algorithm>
#include <numeric>
#include <utility>

#include <Eigen/Cholesky>

namespace hp2 {
namespace {

// A piece that is as near as this to where a closure has it needs no placing.
constexpr double kPlaced_m = 0.5, kPlaced_rad = 0.05;

using Steps = std::vector<OdometryStep>;

Steps part(const Steps& steps, std::size_t begin, std::size_t end) {
  return {steps.begin() + static_cast<std::ptrdiff_t>(begin),
          steps.begin() + static_cast<std::ptrdiff_t>(end)};
}

}  // namespace

AnchoredScans anchored_scans(const std::vector<ScanPose>& scans) {
  AnchoredScans out;
  out.end = scans.size();
  const auto lost = [](const ScanPose& s) { return s.state == TrackingState::kLost; };
  const auto first = std::find_if(scans.begin(), scans.end(), lost);
  if (first == scans.end()) return out;
  const auto last = std::find_if(scans.rbegin(), scans.rend(), lost).base() - 1;
  if (scans.end() - last >= first - scans.begin()) {
    out.begin = static_cast<std::size_t>(last - scans.begin());
    out.starts_piece = true;
  } else {
    out.end = static_cast<std::size_t>(first - scans.begin());
    out.ends_piece = true;
  }
  return out;
}

Submap anchored_submap(Submap submap) {
  const AnchoredScans a = anchored_scans(submap.scans);
  if (!a.starts_piece && !a.ends_piece) return submap;
  const bool normals = submap.normals.size() == submap.points.size();
  std::size_t n = 0;
  for (std::size_t i = 0; i < submap.points.size() && i < submap.scan_indices.size(); ++i) {
    const auto scan = static_cast<std::size_t>(submap.scan_indices[i]);
    if (scan < a.begin || scan >= a.end) continue;
    submap.points[n] = submap.points[i];
    if (normals) submap.normals[n] = submap.normals[i];
    submap.scan_indices[n++] = static_cast<std::int32_t>(scan - a.begin);
  }
  submap.points.resize(n);
  submap.normals.resize(normals ? n : 0);
  submap.scan_indices.resize(n);
  submap.scans = {submap.scans.begin() + static_cast<std::ptrdiff_t>(a.begin),
                  submap.scans.begin() + static_cast<std::ptrdiff_t>(a.end)};
  return submap;
}

GraphEdge odometry_edge(const Submap& submap, const Submap& next, std::int64_t utime_before) {
  GraphEdge edge;
  edge.from = static_cast<std::size_t>(submap.id);
  edge.to = edge.from + 1;
  if (!submap.scans.empty()) edge.from_from_to = submap.scans.back().submap_from_sensor;
  // Errors of the steps before a loss belong to the edge before.
  const Steps steps = odometry_steps(submap.scans, utime_before);
  const AnchoredScans own = anchored_scans(submap.scans), after = anchored_scans(next.scans);
  Matrix6d covariance =
      accumulated_covariance(part(steps, own.starts_piece ? own.begin + 1 : 0, steps.size()));
  if (after.starts_piece) {
    const std::int64_t end = submap.scans.empty() ? 0 : submap.scans.back().utime;
    const Steps lead_in = part(odometry_steps(next.scans, end), 0, after.begin + 1);
    const Matrix6d back = adjoint(next.scans[after.begin].submap_from_sensor);
    covariance += back * accumulated_covariance(lead_in) * back.transpose();
  }
  covariance += 1e-10 * Matrix6d::Identity();
  edge.information = covariance.ldlt().solve(Matrix6d::Identity());
  edge.information = (0.5 * (edge.information + edge.information.transpose())).eval();
  return edge;
}

void place_pieces(std::vector<Pose>& nodes, const std::vector<int>& piece,
                  const std::vector<GraphEdge>& closures) {
  if (piece.empty()) return;
  std::vector<int> group(static_cast<std::size_t>(piece.back()) + 1);
  std::iota(group.begin(), group.end(), 0);
  for (const GraphEdge& c : closures) {
    const int a = group[static_cast<std::size_t>(piece[c.from])],
              b = group[static_cast<std::size_t>(piece[c.to])];
    if (a == b) continue;
    const EdgeGap gap = edge_gap(nodes, c);
    if (gap.translation_m > kPlaced_m || gap.rotation_rad > kPlaced_rad) {
      // The earlier group stays: the first node is in the first one.
      const Pose to = nodes[c.from] * c.from_from_to;
      const Pose move = a < b ? to * nodes[c.to].inverse()
                              : nodes[c.to] * c.from_from_to.inverse() * nodes[c.from].inverse();
      for (std::size_t i = 0; i < nodes.size(); ++i) {
        if (group[static_cast<std::size_t>(piece[i])] == std::max(a, b)) nodes[i] = move * nodes[i];
      }
    }
    for (int& g : group) {
      if (g == std::max(a, b)) g = std::min(a, b);
    }
  }
}

}  // namespace hp2
