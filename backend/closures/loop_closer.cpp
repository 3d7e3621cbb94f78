#include "backend/closures/loop_closer.hpp"

#include <algorithm>
#include <cmath>

#include <spdlog/spdlog.h>

#include "backend/graph/pieces.hpp"
#include "common/session/damage.hpp"

namespace hp2 {

const char* const kRefusedByGraph = "the other closures contradict it";

namespace {

constexpr std::size_t kKeptSubmaps = 8, kKeptMaps = 3;  // maps of a submap take more memory than itself
constexpr int kEnoughClosures = 2;                      // a submap that has so many needs no further ones
constexpr int kFurtherPairs = 2;                        // checked after a correction, a submap
constexpr std::int64_t kLookBack =
    20;  // submaps that a correction gives another chance at once; all get one at the end
constexpr double kNews_m = 0.1, kNews_rad = 0.005;
constexpr int kMaxChecksAPair = 2;
constexpr double kTriedAlready_m = 1.0, kTriedAlready_rad = 0.05;
// Where tracking was lost between two submaps, odometry cannot tell places that look alike apart.
constexpr int kUnknownInliers = 10;
constexpr double kRivalShare = 0.6;  // of the inliers
constexpr double kSamePlace_m = 5.0;
// How far the registration may end from where it began. An image's cells and matches are coarser than a
// corrected graph.
constexpr double kAlikeReach_m = 5.0, kNearReach_m = 3.5, kReach_rad = 0.26;

// True if the pair was looked at from about there before, or often enough.
bool tried(const std::vector<ClosureRecord>& closures, std::int64_t from, std::int64_t to,
           const Pose& guess) {
  int checks = 0;
  for (const ClosureRecord& c : closures) {
    if (c.from_submap != from || c.to_submap != to || c.overlap < 0.0) continue;
    if (c.accepted || c.reason == kRefusedByGraph) return true;
    const Pose off = c.from_from_to.inverse() * guess;
    if (off.translation.norm() < kTriedAlready_m && rotation_angle(off.rotation) < kTriedAlready_rad)
      return true;
    ++checks;
  }
  return checks >= kMaxChecksAPair;
}

// True if an accepted closure among those from `first` on tells the graph something new. On a street that was
// closed before most do not; they count at the next correction, and at the end.
bool graph_is_off(const GraphState& graph, std::size_t first) {
  for (std::size_t i = first; i < graph.closures.size(); ++i) {
    const ClosureRecord& c = graph.closures[i];
    if (!c.accepted) continue;
    const EdgeGap gap = edge_gap(graph.map_from_submap,
                                 {static_cast<std::size_t>(c.from_submap),
                                  static_cast<std::size_t>(c.to_submap), c.from_from_to, c.information});
    if (gap.translation_m > kNews_m || gap.rotation_rad > kNews_rad) return true;
  }
  return false;
}

// Notes where two candidates of about as many inliers would have the newest submap in different places.
void mark_rivals(std::vector<Candidate>& candidates, const std::vector<Pose>& map_from_submap) {
  for (Candidate& a : candidates) {
    const Pose here = map_from_submap[static_cast<std::size_t>(a.from)] * a.guess;
    for (const Candidate& b : candidates) {
      const Pose there = map_from_submap[static_cast<std::size_t>(b.from)] * b.guess;
      a.rivals = a.rivals || (b.inliers >= kRivalShare * a.inliers &&
                              (here.translation - there.translation).norm() > kSamePlace_m);
    }
  }
}

// A pointer to what is there for the time of a call only.
struct Lent {
  Lent(const Submap*& to, const Submap& submap) : pointer(to) { pointer = &submap; }
  ~Lent() { pointer = nullptr; }
  Lent(const Lent&) = delete;
  Lent& operator=(const Lent&) = delete;
  const Submap*& pointer;
};

int closures_of(const std::vector<ClosureRecord>& closures, std::int64_t to) {
  int n = 0;
  for (const ClosureRecord& c : closures) n += c.accepted && c.to_submap == to;
  return n;
}

}  // namespace

std::shared_ptr<const CheckedSubmap> LoopCloser::load(std::int64_t id, const PlaceIndex& index) {
  const auto known =
      std::find_if(recent_.begin(), recent_.end(), [id](const auto& s) { return s->id == id; });
  if (known != recent_.end()) recent_.splice(recent_.begin(), recent_, known);
  // Its own are among the first kKeptMaps, be it here or about to come.
  std::size_t number = known != recent_.end() ? 0 : 1;
  for (const auto& submap : recent_) {
    if (++number > kKeptMaps) submap->drop_maps();
  }
  if (known != recent_.end()) return recent_.front();
  const GroundAlignment& ground = index.places()[static_cast<std::size_t>(id)].ground;
  const bool stored = newest_ == nullptr || newest_->id != id;
  recent_.push_front(std::make_shared<CheckedSubmap>(
      stored ? anchored_submap(store_.read_submap(id)) : anchored_submap(*newest_), ground));
  if (recent_.size() > kKeptSubmaps) recent_.pop_back();
  return recent_.front();
}

bool LoopCloser::check(std::int64_t to, const Candidate& candidate, const PlaceIndex& index,
                       const std::vector<double>& distances, GraphState& graph,
                       std::vector<std::size_t>& changed, int& budget) {
  const auto f = static_cast<std::size_t>(candidate.from), t = static_cast<std::size_t>(to);
  const Pose predicted = graph.map_from_submap[f].inverse() * graph.map_from_submap[t];
  const PoseBound bound = drift_bound(predicted, distances[f], candidate.inliers, config_);
  const bool alike = candidate.inliers > 0;
  ClosureRecord record;
  const auto refuse = [&](const char* reason) {
    record.from_submap = candidate.from;
    record.to_submap = to;
    record.from_from_to = candidate.guess;
    record.reason = reason;
  };
  const Pose off = predicted.inverse() * candidate.guess;
  const double slack = alike ? kAlikeReach_m : 0.0;
  if (off.translation.norm() > bound.translation_m + slack ||
      rotation_angle(off.rotation) > bound.rotation_rad + kReach_rad) {
    refuse("the images' alignment is further from odometry than its drift allows");
  } else if (!std::isfinite(distances[f]) && candidate.inliers < kUnknownInliers) {
    refuse("too few features agree for a place of which odometry says nothing");
  } else if (!std::isfinite(distances[f]) && candidate.rivals) {
    refuse("other places look as much like it, and odometry says nothing of them");
  } else {
    --budget;
    try {
      record = verify_closure(*load(candidate.from, index), *load(to, index), candidate.guess, bound,
                              candidate.max_path_distance_m, alike ? kAlikeReach_m : kNearReach_m, kReach_rad,
                              closures_of(graph.closures, to) == 0, config_);
    } catch (const DamageError& e) {
      spdlog::warn("{}", e.what());
      refuse("what is stored of one of them is damaged");
    }
  }
  record.inliers = candidate.inliers;
  changed.push_back(graph.closures.size());
  graph.closures.push_back(record);
  return record.accepted;
}

void LoopCloser::correct(const PlaceIndex& index, const std::vector<GraphEdge>& odometry, GraphState& graph,
                         std::vector<std::size_t>& changed) {
  std::vector<std::size_t> numbers;
  std::vector<GraphEdge> closures;
  for (std::size_t i = 0; i < graph.closures.size(); ++i) {
    const ClosureRecord& c = graph.closures[i];
    if (!c.accepted && c.reason != kRefusedByGraph) continue;
    numbers.push_back(i);
    closures.push_back({static_cast<std::size_t>(c.from_submap), static_cast<std::size_t>(c.to_submap),
                        c.from_from_to, c.information});
  }
  std::vector<int> pieces;
  for (const Place& place : index.places()) pieces.push_back(place.piece);
  place_pieces(graph.map_from_submap, pieces, closures);
  const std::vector<bool> used = optimise_consistent(graph.map_from_submap, odometry, closures);
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    ClosureRecord& c = graph.closures[numbers[k]];
    if (c.accepted == used[k]) continue;
    c.accepted = used[k];
    c.reason = used[k] ? "" : kRefusedByGraph;
    changed.push_back(numbers[k]);
  }
}

// Pairs of `to` with what the graph says it overlaps. @return how many were checked
int LoopCloser::check_further(std::int64_t to, const PlaceIndex& index, int budget, GraphState& graph,
                              std::vector<std::size_t>& changed, int& accepted) {
  int left = budget;
  int have = closures_of(graph.closures, to);
  if (left <= 0 || have >= kEnoughClosures) return 0;
  const auto distances = graph_distances(index.places(), graph.closures, to);
  for (const Candidate& c : index.near(to, graph.map_from_submap, distances)) {
    if (left <= 0 || have >= kEnoughClosures) break;
    if (tried(graph.closures, c.from, to, c.guess)) continue;
    if (!check(to, c, index, distances, graph, changed, left)) continue;
    ++have;
    ++accepted;
  }
  return budget - left;
}

bool LoopCloser::close(const Submap& newest, const Features& features, const PlaceIndex& index,
                       const std::vector<GraphEdge>& odometry, GraphState& graph,
                       std::vector<std::size_t>& changed) {
  recent_.remove_if([&](const auto& s) { return s->id == newest.id; });  // of an attempt that was not stored
  const Lent lent(newest_, newest);
  const std::int64_t to = newest.id;
  const std::size_t first_new = graph.closures.size();
  int budget = config_.candidates_per_submap, accepted = 0;
  const auto distances = graph_distances(index.places(), graph.closures, to);
  std::vector<Candidate> candidates = index.alike(features);
  mark_rivals(candidates, graph.map_from_submap);
  for (const Candidate& c : candidates) {
    if (budget <= 0 || accepted >= kEnoughClosures) break;
    accepted += check(to, c, index, distances, graph, changed, budget);
  }
  if (config_.graph_candidates) check_further(to, index, budget, graph, changed, accepted);
  if (accepted == 0 || !graph_is_off(graph, first_new)) return false;
  correct(index, odometry, graph, changed);

  // The corrected graph may show that submaps before this one came back as well: one that was too far off
  // then.
  int further = config_.graph_candidates ? kFurtherPairs : 0, more = 0;
  for (std::int64_t k = to; k >= std::max<std::int64_t>(0, to - kLookBack) && further > 0; --k) {
    further -= check_further(k, index, further, graph, changed, more);
  }
  if (more > 0 && graph_is_off(graph, first_new)) correct(index, odometry, graph, changed);
  return true;
}

bool LoopCloser::close_all(const PlaceIndex& index, const std::vector<GraphEdge>& odometry, int budget,
                           GraphState& graph, std::vector<std::size_t>& changed) {
  int accepted = 0;
  if (config_.graph_candidates) {
    for (auto k = static_cast<std::int64_t>(index.places().size()) - 1; k >= 0 && budget > 0; --k) {
      budget -= check_further(k, index, budget, graph, changed, accepted);
    }
  }
  const bool any =
      std::any_of(graph.closures.begin(), graph.closures.end(), [](const auto& c) { return c.accepted; });
  if (any) correct(index, odometry, graph, changed);
  return any;
}

}  // namespace hp2
