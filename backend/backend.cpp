#include "backend/backend.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include <spdlog/spdlog.h>

#include "backend/closures/loop_closer.hpp"
#include "backend/graph/derived.hpp"
#include "backend/graph/motion_smoothing.hpp"
#include "backend/graph/pieces.hpp"
#include "backend/graph/pose_graph.hpp"
#include "backend/graph/scan_refinement.hpp"
#include "backend/places/loop_candidates.hpp"
#include "common/error.hpp"
#include "common/session/damage.hpp"

namespace hp2 {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kFinalChecks = 200;  // pairs that are checked at the end of a session

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
      : config_(config), store_(store), index_(config), closer_(config, store), graph_(read_graph(store)) {
    for (std::int64_t id = 0; id < store.submap_count(); ++id) {
      submaps_.push_back(store.read_submap(id, false));
      auto [place, features] = take_place(id);
      index_.add_place(std::move(place));
      index_.add_features(features);
    }
    if (has_derived(graph_, submaps_)) return;
    // An older version, or damaged: edges and trajectory are computed again from the submaps.
    const auto smoothed = store.read_meta()[kScansSmoothed];
    graph_.odometry = odometry_edges(submaps_);
    graph_.trajectory = final_trajectory(submaps_, graph_, graph_.ended && smoothed == "yes");
    SessionChange change;
    change.graph = &graph_;
    store.commit(change);
  }

  BackendUpdate add_submap(const Submap& submap, const std::vector<std::uint8_t>& frontend_state, bool last) {
    const auto start = Clock::now();
    BackendUpdate update;
    if (submap.id >= 0 && submap.id < static_cast<std::int64_t>(submaps_.size())) return update;
    check_submap(submap, static_cast<std::int64_t>(submaps_.size()));

    auto [place, features] =
        make_place(submap, index_.places().empty() ? nullptr : &index_.places().back(), config_);
    const std::vector<std::uint8_t> place_bytes = encode_place(place, features);
    GraphState next = graph_;
    ++next.revision;
    next.ended = false;
    // The map begins where the first scan was taken, wherever odometry says that was.
    if (submap.id == 0) next.map_from_odom = submap.odom_from_submap.inverse();
    next.map_from_submap.push_back(next.map_from_odom * submap.odom_from_submap);
    SessionChange change;
    change.submap = &submap;
    change.last = last;
    change.frontend_state = &frontend_state;
    change.place = &place_bytes;
    change.graph = &next;

    // If anything fails from here on, the back-end's state must not change.
    index_.add_place(std::move(place));
    change.new_edges_from = next.odometry.size();
    if (submap.id > 0) next.odometry.push_back(edge_to(submap, submaps_.size() - 1));
    try {
      if (config_.loop_closing) {
        update.graph_changed =
            closer_.close(submap, features, index_, next.odometry, next, change.changed_closures);
      }
      set_map_from_odom(submap.odom_from_submap, next);
      // The end of the submap before was free until now: its last scan is this one's keypose. Where an ended
      // session continues, all scans get their poses from before the smoothing.
      change.moved_from = update.graph_changed || graph_.ended ? 0 : std::max<std::int64_t>(submap.id - 1, 0);
      rebuild_trajectory(change.moved_from, &submap, next);
      append_trajectory(submap, nullptr, next.map_from_submap, next.trajectory);
      store_.commit(change);
    } catch (...) {
      index_.remove_newest_place();
      throw;
    }
    index_.add_features(features);
    submaps_.push_back(without_points(submap));
    adopt(std::move(next), change.changed_closures, update);
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
    if (config_.loop_closing && !submaps_.empty()) {
      update.graph_changed =
          closer_.close_all(index_, next.odometry, kFinalChecks, next, change.changed_closures);
      set_map_from_odom(submaps_.back().odom_from_submap, next);
      rebuild_trajectory(0, nullptr, next);
    }
    change.new_edges_from = next.odometry.size();
    store_.write_meta({{kScansSmoothed, config_.smooth_scans ? "yes" : "no"}});
    if (config_.smooth_scans) smooth_trajectory(submaps_, next.trajectory);
    store_.commit(change);
    adopt(std::move(next), change.changed_closures, update);
    update.ms_total = ms_since(start);
    return update;
  }

  const GraphState& graph() const { return graph_; }

 private:
  static GraphState read_graph(const SessionStore& store) {
    std::vector<std::string> said;
    GraphState graph = store.read_graph(OnDamage::kThrow, &said);
    for (const std::string& text : said) spdlog::warn("{}", text);
    return graph;
  }

  // The place of a stored submap; one that is damaged or of an older version is computed again.
  std::pair<Place, Features> take_place(std::int64_t id) {
    const std::string name = "submap " + std::to_string(id);
    try {
      return decode_place(store_.read_place(id), name);
    } catch (const DamageError&) {
      spdlog::warn("the place of {} cannot be read and is made again", name);
    }
    auto made = make_place(store_.read_submap(id),
                           index_.places().empty() ? nullptr : &index_.places().back(), config_);
    store_.write_place(id, encode_place(made.first, made.second));
    return made;
  }

  static void set_map_from_odom(const Pose& odom_from_newest, GraphState& graph) {
    graph.map_from_odom = graph.map_from_submap.back() * odom_from_newest.inverse();
  }

  void adopt(GraphState next, const std::vector<std::size_t>& changed, BackendUpdate& update) {
    for (std::size_t i = graph_.closures.size(); i < next.closures.size(); ++i) {
      update.new_verdicts.push_back(next.closures[i]);
    }
    for (const std::size_t i : changed) {
      if (i < graph_.closures.size()) update.new_verdicts.push_back(next.closures[i]);
    }
    graph_ = std::move(next);
  }

  // The edge from submap `k`, which is stored, to the one after it.
  GraphEdge edge_to(const Submap& after, std::size_t k) const {
    const bool known = k > 0 && !submaps_[k - 1].scans.empty();
    return odometry_edge(submaps_[k], after, known ? submaps_[k - 1].scans.back().utime : 0);
  }

  // Computes the trajectory of the stored submaps from `first` on again from the keyposes. `newest` follows
  // them.
  void rebuild_trajectory(std::int64_t first, const Submap* newest, GraphState& graph) const {
    auto& t = graph.trajectory;
    while (!t.empty() && t.back().submap >= first) t.pop_back();
    for (auto k = static_cast<std::size_t>(first); k < submaps_.size(); ++k) {
      append_trajectory(submaps_[k], k + 1 < submaps_.size() ? &submaps_[k + 1] : newest,
                        graph.map_from_submap, t);
    }
  }

  BackendConfig config_;
  SessionStore& store_;
  PlaceIndex index_;
  LoopCloser closer_;
  GraphState graph_;
  std::vector<Submap> submaps_;  // without points
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
