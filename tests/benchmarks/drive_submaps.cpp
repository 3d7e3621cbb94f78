#include "drive_submaps.hpp"

#include <utility>

#include "common/registration/submap_normals.hpp"
#include "frontend/frontend.hpp"
#include "frontend/odometry/submap_builder.hpp"

namespace hp2 {

void register_drive(const ScanSource& source, double submap_length_m, const std::string& mode, const Gap& gap,
                    SessionStore& store) {
  FrontendConfig config;
  config.submap_length_m = submap_length_m;
  config.mode = mode;
  Frontend frontend(config, 1);
  const auto keep = [&](Submap m, bool last) {
    estimate_normals(m);
    const std::vector<std::uint8_t> no_state;
    SessionChange change;
    change.submap = &m;
    change.frontend_state = &no_state;
    change.last = last;
    store.commit(change);
  };
  for (std::size_t i = 0; i < source.size(); ++i) {
    if (i >= gap.first && i - gap.first < gap.count) continue;
    auto out = frontend.process(source.read(i));
    if (out.finished_submap) keep(std::move(*out.finished_submap), false);
  }
  if (auto rest = frontend.finish()) keep(std::move(*rest), true);
}

Submap with_drift(Submap m, double scale, double yaw_per_m, const Pose& odom_from_submap) {
  Pose before, after;
  std::vector<Pose> moved(m.scans.size());
  for (std::size_t i = 0; i < m.scans.size(); ++i) {
    const Pose step = before.inverse() * m.scans[i].submap_from_sensor;
    const double length = step.translation.norm();
    const Pose drift(so3_exp({0.0, 0.0, yaw_per_m * length}), scale * step.translation);
    before = m.scans[i].submap_from_sensor;
    after = after * step * drift;
    moved[i] = after * m.scans[i].submap_from_sensor.inverse();
    m.scans[i].submap_from_sensor = after;
  }
  for (std::size_t i = 0; i < m.points.size(); ++i) {
    const Pose& move = moved[static_cast<std::size_t>(m.scan_indices[i])];
    m.points[i] = (move * m.points[i].cast<double>()).cast<float>();
    m.normals[i] = (move.rotation * m.normals[i].cast<double>()).cast<float>();
  }
  m.odom_from_submap = odom_from_submap;
  return m;
}

}  // namespace hp2
