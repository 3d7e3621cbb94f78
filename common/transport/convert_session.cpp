// Graph, closures and trajectory; scans and submaps are in convert.cpp.
#include <algorithm>
#include <utility>

#include "common/transport/convert.hpp"
#include "common/transport/convert_checks.hpp"

namespace hp2 {
namespace {

std::optional<ClosureRecord> to_closure(const closure_t& m) {
  const auto pose = to_pose(m.from_from_to);
  if (!pose || !all_finite(m.information)) return std::nullopt;
  ClosureRecord c;
  c.from_submap = m.from_submap;
  c.to_submap = m.to_submap;
  c.from_from_to = *pose;
  c.information = to_matrix(m.information);
  c.inliers = m.inliers;
  c.overlap = m.overlap;
  c.residual_m = m.residual;
  c.accepted = m.accepted != 0;
  c.reason = m.reason;
  return c;
}

}  // namespace

closure_t to_message(const ClosureRecord& closure, std::int64_t session_id, std::int64_t number) {
  closure_t m{};
  m.session_id = session_id;
  m.number = number;
  m.from_submap = closure.from_submap;
  m.to_submap = closure.to_submap;
  m.from_from_to = to_message(closure.from_from_to);
  from_matrix(closure.information, m.information);
  m.inliers = closure.inliers;
  m.overlap = closure.overlap;
  m.residual = closure.residual_m;
  m.accepted = closure.accepted ? 1 : 0;
  m.reason = closure.reason;
  return m;
}

ByteVector encode_graph(const GraphState& graph, std::int64_t session_id) {
  graph_t m;
  m.session_id = session_id;
  m.revision = graph.revision;
  m.ended = graph.ended ? 1 : 0;
  m.map_from_odom = to_message(graph.map_from_odom);
  m.n_nodes = static_cast<std::int32_t>(graph.map_from_submap.size());
  for (const auto& pose : graph.map_from_submap) m.map_from_submap.push_back(to_message(pose));
  m.n_odometry = static_cast<std::int32_t>(graph.odometry.size());
  for (const auto& edge : graph.odometry) {
    edge_t e{};
    e.from_from_to = to_message(edge.from_from_to);
    from_matrix(edge.information, e.information);
    m.odometry.push_back(e);
  }
  m.n_closures = static_cast<std::int32_t>(graph.closures.size());
  for (std::size_t i = 0; i < graph.closures.size(); ++i) {
    m.closures.push_back(to_message(graph.closures[i], session_id, static_cast<std::int64_t>(i)));
  }
  return encode_message(m);
}

std::optional<GraphState> decode_graph(const std::uint8_t* data, std::size_t size, std::int64_t session_id) {
  graph_t m;
  if (!safe_decode(data, size, m) || m.session_id != session_id) return std::nullopt;
  GraphState graph;
  graph.revision = m.revision;
  graph.ended = m.ended != 0;
  const auto correction = to_pose(m.map_from_odom);
  if (!correction) return std::nullopt;
  graph.map_from_odom = *correction;
  for (const auto& node : m.map_from_submap) {
    const auto pose = to_pose(node);
    if (!pose) return std::nullopt;
    graph.map_from_submap.push_back(*pose);
  }
  if (m.n_odometry + 1 != std::max(m.n_nodes, 1)) return std::nullopt;
  for (const auto& e : m.odometry) {
    const auto pose = to_pose(e.from_from_to);
    if (!pose || !all_finite(e.information)) return std::nullopt;
    const std::size_t k = graph.odometry.size();
    graph.odometry.push_back({k, k + 1, *pose, to_matrix(e.information)});
  }
  for (const auto& c : m.closures) {
    auto closure = to_closure(c);
    if (!closure || closure->from_submap < 0 || closure->to_submap < 0 || closure->from_submap >= m.n_nodes ||
        closure->to_submap >= m.n_nodes) {
      return std::nullopt;
    }
    graph.closures.push_back(std::move(*closure));
  }
  return graph;
}

ByteVector encode_trajectory(const GraphState& graph, std::int64_t session_id) {
  trajectory_t m;
  m.session_id = session_id;
  m.revision = graph.revision;
  m.n = static_cast<std::int32_t>(graph.trajectory.size());
  for (const auto& p : graph.trajectory) {
    m.sequence.push_back(p.sequence);
    m.utime.push_back(p.utime);
    m.submap.push_back(static_cast<std::int32_t>(p.submap));
    m.odom_from_sensor.push_back(to_message(p.odom_from_sensor));
    m.map_from_sensor.push_back(to_message(p.map_from_sensor));
  }
  return encode_message(m);
}

std::optional<TrajectoryAtRevision> decode_trajectory(const std::uint8_t* data, std::size_t size,
                                                      std::int64_t session_id) {
  trajectory_t m;
  if (!safe_decode(data, size, m) || m.session_id != session_id) return std::nullopt;
  TrajectoryAtRevision result;
  result.revision = m.revision;
  for (std::size_t i = 0; i < static_cast<std::size_t>(m.n); ++i) {
    const auto odom = to_pose(m.odom_from_sensor[i]), map = to_pose(m.map_from_sensor[i]);
    if (!odom || !map || m.submap[i] < 0 || !sane_time(m.utime[i])) return std::nullopt;
    result.trajectory.push_back({m.sequence[i], m.utime[i], m.submap[i], *odom, *map});
  }
  return result;
}

}  // namespace hp2
