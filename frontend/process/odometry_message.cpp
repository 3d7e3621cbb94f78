#include "frontend/process/odometry_message.hpp"

#include "common/transport/convert.hpp"

namespace hp2 {

odometry_t to_message(const OdometryResult& r, std::int64_t session_id, std::int64_t sender_id,
                      std::int64_t number) {
  odometry_t m{};
  m.session_id = session_id;
  m.sender_id = sender_id;
  m.number = number;
  m.utime = r.utime;
  m.sequence = r.sequence;
  m.odom_from_sensor = to_message(r.odom_from_sensor);
  m.submap_id = r.submap_id;
  m.submap_from_sensor = to_message(r.submap_from_sensor);
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>{m.covariance} = r.covariance;
  m.alpha = r.diagnostics.alpha;
  m.n_planar = r.n_planar;
  m.n_non_planar = r.n_non_planar;
  m.sigma = r.diagnostics.sigma;
  m.iterations = r.diagnostics.iterations;
  m.min_eigenvalue_ratio = r.diagnostics.min_eigenvalue_ratio;
  m.state = static_cast<std::int8_t>(r.state);
  m.n_points = r.n_points;
  m.n_dropped = r.n_dropped;
  m.n_skipped = r.n_skipped;
  const auto& ms = r.diagnostics.ms;
  m.ms_preprocess = ms[0];
  m.ms_neighbour_search = ms[1];
  m.ms_planarity = ms[2];
  m.ms_solve = ms[3];
  m.ms_map_update = ms[4];
  m.ms_total = ms[5];
  return m;
}

}  // namespace hp2
