#include "backend/backend.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "backend/scan_refinement.hpp"
#include "common/error.hpp"

namespace hp2 {
namespace {

using Clock = std::chrono::steady_clock;

double ms_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

Submap without_points(const Submap& submap) {
  Submap m;
  m.id = submap.id;
  m.odom_from_submap = submap.odom_from_submap;
  m.scans = submap.scans;
  m.travelled_m = submap.travelled_m;
  m.scans_skipped = submap.scans_skipped;
  return m;
}

void check_submap(const Submap& submap, std::int64_t expected_id) {
  const std::string where = "submap " + std::to_string(submap.id);
  if (submap.id != expected_id) {
    throw Error("a submap is missing before this one", where,
                "Send submap " + std::to_string(expected_id) + " first.");
  }
  bool finite = submap.odom_from_submap.is_finite();
  for (const ScanPose& s : submap.scans) finite = finite && s.submap_from_sensor.is_finite();
  if (!finite) throw Error("a pose is not finite", where, "Mend the front-end that made it.");
}

}  // namespace

class Backend::Impl {
 public:
  Impl(const BackendConfig& config, SessionStore& store)
      : config_(config), store_(store), graph_(store.read_graph()) {
    for (std::int64_t id = 0; id < store.submap_count(); ++id)
      submaps_.push_back(store.read_submap(id, false));
  }

  BackendUpdate add_submap(const Submap& submap, const std::vector<std::uint8_t>& frontend_state, bool last) {
    const auto start = Clock::now();
    BackendUpdate update;
    if (submap.id >= 0 && submap.id < static_cast<std::int64_t>(submaps_.size())) return update;
    check_submap(submap, static_cast<std::int64_t>(submaps_.size()));

    GraphState next = graph_;
    ++next.revision;
    next.map_from_submap.push_back(next.map_from_odom * submap.odom_from_submap);
    // The submap before ended freely until now; its last scan is this one's keypose.
    rebuild_trajectory(std::max<std::int64_t>(submap.id - 1, 0), next);
    append_trajectory(submap, next.map_from_submap, next.trajectory);

    SessionChange change;
    change.submap = &submap;
    change.last = last;
    change.frontend_state = &frontend_state;
    change.graph = &next;
    store_.commit(change);

    graph_ = std::move(next);
    submaps_.push_back(without_points(submap));
    update.ms_total = ms_since(start);
    return update;
  }

  BackendUpdate finish() {
    const auto start = Clock::now();
    BackendUpdate update;
    if (graph_.ended) return update;
    GraphState next = graph_;
    ++next.revision;
    next.ended = true;
    SessionChange change;
    change.graph = &next;
    store_.commit(change);
    graph_ = std::move(next);
    update.ms_total = ms_since(start);
    return update;
  }

  const GraphState& graph() const { return graph_; }

 private:
  // Derives the trajectory of the stored submaps from `first` on from the keyposes anew.
  void rebuild_trajectory(std::int64_t first, GraphState& graph) const {
    auto& t = graph.trajectory;
    while (!t.empty() && t.back().submap >= first) t.pop_back();
    for (auto k = static_cast<std::size_t>(first); k < submaps_.size(); ++k) {
      append_trajectory(submaps_[k], graph.map_from_submap, t);
    }
  }

  BackendConfig config_;
  SessionStore& store_;
  GraphState graph_;
  std::vector<Submap> submaps_;  ///< Without points.
};

Backend::Backend(const BackendConfig& config, SessionStore& store)
    : impl_(std::make_unique<Impl>(config, store)) {}
Backend::~Backend() = default;

BackendUpdate Backend::add_submap(const Submap& submap, const std::vector<std::uint8_t>& frontend_state,
                                  bool last) {
  return impl_->add_submap(submap, frontend_state, last);
}

BackendUpdate Backend::finish() { return impl_->finish(); }

const GraphState& Backend::graph() const { return impl_->graph(); }

}  // namespace hp2
