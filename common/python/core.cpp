// The Python module hp2slam._core: odometry on arrays, stored sessions, evaluation. hp2slam/__init__.py
// documents it.
#include <cmath>
#include <memory>
#include <optional>
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <string>

#include "common/error.hpp"
#include "common/evaluation/metrics.hpp"
#include "common/session/session_store.hpp"
#include "frontend/frontend.hpp"

namespace py = pybind11;

namespace hp2 {
namespace {

using Floats = py::array_t<float, py::array::c_style | py::array::forcecast>;
using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast>;

py::array_t<double> matrices(std::size_t n) {
  return py::array_t<double>({static_cast<py::ssize_t>(n), py::ssize_t{4}, py::ssize_t{4}});
}

void write_matrix(const Pose& pose, double* out) {
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> m(out);
  m.setIdentity();
  m.topRows<3>() = pose.matrix();
}

template <typename Get>
py::array_t<double> poses(std::size_t n, const Get& get) {
  auto out = matrices(n);
  for (std::size_t i = 0; i < n; ++i) write_matrix(get(i), out.mutable_data() + 16 * i);
  return out;
}

template <typename T, typename Get>
py::array_t<T> numbers(std::size_t n, const Get& get) {
  py::array_t<T> out(static_cast<py::ssize_t>(n));
  for (std::size_t i = 0; i < n; ++i) out.mutable_data()[i] = get(i);
  return out;
}

py::object matrix(const Pose& pose) {
  return poses(1, [&](std::size_t) { return pose; })[py::int_(0)];
}

const char* state_name(TrackingState state) {
  switch (state) {
    case TrackingState::kTracking:
      return "tracking";
    case TrackingState::kDegenerate:
      return "degenerate";
    default:
      return "lost";
  }
}

py::dict estimate(const OdometryResult& o) {
  py::dict d;
  d["sequence"] = o.sequence;
  d["stamp_s"] = static_cast<double>(o.utime) * 1e-6;
  d["pose"] = matrix(o.odom_from_sensor);
  d["covariance"] = Matrix6d(o.covariance);
  d["state"] = state_name(o.state);
  d["planar"] = o.n_planar;
  d["non_planar"] = o.n_non_planar;
  d["alpha"] = o.diagnostics.alpha;
  d["sigma_m"] = o.diagnostics.sigma;
  d["iterations"] = o.diagnostics.iterations;
  d["ms"] = o.diagnostics.ms.back();
  return d;
}

class Odometry {
 public:
  Odometry(int threads, const std::map<std::string, std::string>& settings) {
    Config file;
    file.add(frontend_section(config_));
    file.add(sensor_section(config_.sensor));
    for (const auto& [key, value] : settings)
      file.set((key.rfind("sensor.", 0) == 0 ? key : "frontend." + key) + "=" + value);
    validate(config_);
    frontend_ = std::make_unique<Frontend>(config_, threads);
  }

  py::dict process(const Floats& points, double stamp_s, double duration_s, const std::optional<Floats>& time,
                   const std::optional<std::int64_t>& sequence) {
    if (points.ndim() != 2 || points.shape(1) < 3)
      throw Error("points are not an array of n rows and at least 3 columns", "Odometry.process",
                  "Give x, y, z [m] per row.");
    if (!std::isfinite(stamp_s) || !std::isfinite(duration_s) || duration_s < 0)
      throw Error("stamp_s or duration_s is not a finite time", "Odometry.process", "Give seconds.");
    const auto n = static_cast<std::size_t>(points.shape(0));
    if (time && (time->ndim() != 1 || static_cast<std::size_t>(time->shape(0)) != n))
      throw Error("time does not have one number per point", "Odometry.process",
                  "Give the time in the sweep of each point, 0 at its start, 1 at its end.");
    Scan scan;
    scan.sequence = sequence.value_or(next_);
    next_ = scan.sequence + 1;
    scan.utime = std::llround(stamp_s * 1e6);
    scan.duration_us = std::llround(duration_s * 1e6);
    const auto p = points.unchecked<2>();
    for (auto* axis : {&scan.x, &scan.y, &scan.z}) axis->resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const auto row = static_cast<py::ssize_t>(i);
      scan.x[i] = p(row, 0);
      scan.y[i] = p(row, 1);
      scan.z[i] = p(row, 2);
    }
    if (time) scan.time.assign(time->data(), time->data() + n);
    FrontendOutput out;
    {
      const py::gil_scoped_release others_run;
      out = frontend_->process(scan);
    }
    py::dict d = estimate(out.odometry);
    py::list revised;
    for (const OdometryResult& o : out.revised) revised.append(estimate(o));
    d["revised"] = revised;
    return d;
  }

  std::vector<std::string> take_warnings() { return frontend_->take_warnings(); }

 private:
  FrontendConfig config_;
  std::unique_ptr<Frontend> frontend_;
  std::int64_t next_ = 0;
};

class Session {
 public:
  explicit Session(const std::string& folder)
      : store_(folder, SessionStore::Access::kReadOnly), graph_(store_.read_graph()) {}

  std::int64_t id() const { return store_.session_id(); }
  std::int64_t submap_count() const { return store_.submap_count(); }
  bool ended() const { return graph_.ended; }
  std::map<std::string, std::string> meta() const { return store_.read_meta(); }

  py::array_t<double> map_poses() const {
    return poses(graph_.trajectory.size(),
                 [&](std::size_t i) { return graph_.trajectory[i].map_from_sensor; });
  }
  py::array_t<double> odometry_poses() const {
    return poses(graph_.trajectory.size(),
                 [&](std::size_t i) { return graph_.trajectory[i].odom_from_sensor; });
  }
  py::array_t<double> keyposes() const {
    return poses(graph_.map_from_submap.size(), [&](std::size_t i) { return graph_.map_from_submap[i]; });
  }
  py::array_t<double> stamps() const {
    return numbers<double>(graph_.trajectory.size(), [&](std::size_t i) {
      return static_cast<double>(graph_.trajectory[i].utime) * 1e-6;
    });
  }
  py::array_t<std::int64_t> sequences() const {
    return numbers<std::int64_t>(graph_.trajectory.size(),
                                 [&](std::size_t i) { return graph_.trajectory[i].sequence; });
  }

  // Points of one submap in the map: each with the final pose of the scan that saw it.
  py::array_t<float> points(std::int64_t id) const {
    const Submap submap = store_.read_submap(id);
    std::map<std::int64_t, const TrajectoryPose*> final_poses;
    for (const TrajectoryPose& t : graph_.trajectory)
      if (t.submap == id) final_poses[t.sequence] = &t;
    const Pose keypose = graph_.map_from_submap.at(static_cast<std::size_t>(id));
    std::vector<Pose> map_from_submap(submap.scans.size(), keypose);
    for (std::size_t i = 0; i < submap.scans.size(); ++i) {
      const auto found = final_poses.find(submap.scans[i].sequence);
      if (found != final_poses.end())
        map_from_submap[i] = found->second->map_from_sensor * submap.scans[i].submap_from_sensor.inverse();
    }
    py::array_t<float> out({static_cast<py::ssize_t>(submap.points.size()), py::ssize_t{3}});
    for (std::size_t i = 0; i < submap.points.size(); ++i) {
      const auto scan = static_cast<std::size_t>(submap.scan_indices[i]);
      const Pose& pose = scan < map_from_submap.size() ? map_from_submap[scan] : keypose;
      const Eigen::Vector3f p = (pose * submap.points[i].cast<double>()).cast<float>();
      std::copy(p.data(), p.data() + 3, out.mutable_data() + 3 * i);
    }
    return out;
  }

  py::list closures() const {
    py::list out;
    for (const ClosureRecord& c : graph_.closures) {
      py::dict d;
      d["from_submap"] = c.from_submap;
      d["to_submap"] = c.to_submap;
      d["from_from_to"] = matrix(c.from_from_to);
      d["information"] = Matrix6d(c.information);
      d["accepted"] = c.accepted;
      d["reason"] = c.reason;
      d["inliers"] = c.inliers;
      d["overlap"] = c.overlap;
      d["residual_m"] = c.residual_m;
      out.append(d);
    }
    return out;
  }

 private:
  SessionStore store_;
  GraphState graph_;
};

Trajectory trajectory(const Doubles& matrices, const std::optional<Doubles>& stamps_s, const char* name) {
  if (matrices.ndim() != 3 || matrices.shape(1) < 3 || matrices.shape(1) > 4 || matrices.shape(2) != 4)
    throw Error("poses are not an array of n matrices of 4x4 or 3x4", name,
                "Give world_from_sensor per row.");
  Trajectory out;
  const auto m = matrices.unchecked<3>();
  for (py::ssize_t i = 0; i < m.shape(0); ++i) {
    Eigen::Matrix4d pose = Eigen::Matrix4d::Identity();
    for (py::ssize_t r = 0; r < 3; ++r)
      for (py::ssize_t c = 0; c < 4; ++c) pose(r, c) = m(i, r, c);
    out.poses.push_back(pose);
  }
  if (stamps_s) {
    if (stamps_s->ndim() != 1 || stamps_s->shape(0) != m.shape(0))
      throw Error("there is not one stamp per pose", name, "Give seconds, one per pose, or none.");
    out.times_s.assign(stamps_s->data(), stamps_s->data() + stamps_s->shape(0));
  }
  return out;
}

std::string evaluate_json(const Doubles& reference, const Doubles& estimate,
                          const std::optional<Doubles>& reference_stamps,
                          const std::optional<Doubles>& estimate_stamps, const std::string& alignment,
                          double max_difference_s) {
  AssociationOptions options;
  options.max_difference_s = max_difference_s;
  const auto pairs =
      associate(trajectory(reference, reference_stamps, "reference"),
                trajectory(estimate, estimate_stamps, "estimate"), options, "reference", "estimate");
  return to_json(evaluate(pairs.first, pairs.second, parse_alignment(alignment))).dump();
}

}  // namespace
}  // namespace hp2

PYBIND11_MODULE(_core, m) {
  using namespace pybind11::literals;
  py::register_exception<hp2::Error>(m, "Error", PyExc_ValueError);
  py::class_<hp2::Odometry>(m, "Odometry")
      .def(py::init<int, const std::map<std::string, std::string>&>(), "threads"_a, "settings"_a)
      .def("process", &hp2::Odometry::process, "points"_a, "stamp_s"_a, "duration_s"_a, "time"_a,
           "sequence"_a)
      .def("take_warnings", &hp2::Odometry::take_warnings);
  py::class_<hp2::Session>(m, "Session")
      .def(py::init<const std::string&>(), "folder"_a)
      .def_property_readonly("id", &hp2::Session::id)
      .def_property_readonly("submap_count", &hp2::Session::submap_count)
      .def_property_readonly("ended", &hp2::Session::ended)
      .def_property_readonly("meta", &hp2::Session::meta)
      .def_property_readonly("poses", &hp2::Session::map_poses)
      .def_property_readonly("odometry_poses", &hp2::Session::odometry_poses)
      .def_property_readonly("keyposes", &hp2::Session::keyposes)
      .def_property_readonly("stamps_s", &hp2::Session::stamps)
      .def_property_readonly("sequences", &hp2::Session::sequences)
      .def_property_readonly("closures", &hp2::Session::closures)
      .def("points", &hp2::Session::points, "submap"_a);
  m.def("evaluate_json", &hp2::evaluate_json);
}
