// Closes loops: chooses candidates, checks them in 3D, and keeps the graph and its closures consistent.
#pragma once
#include <cstdint>
#include <list>
#include <memory>
#include <vector>

#include "backend/backend_config.hpp"
#include "backend/closures/closure_verifier.hpp"
#include "backend/graph/pose_graph.hpp"
#include "backend/places/loop_candidates.hpp"
#include "common/session/session_store.hpp"

namespace hp2 {

/// Reason of a closure that passed the 3D check but that the other closures contradict.
extern const char* const kRefusedByGraph;

/// Works on the state that it is given; keeps nothing of a session but a few submaps that were used
/// recently.
class LoopCloser {
 public:
  LoopCloser(const BackendConfig& config, const SessionStore& store) : config_(config), store_(store) {}

  /// Checks submaps that look like the newest one or are near it, then further pairs that overlap in the
  /// corrected graph.
  /// @param newest   the newest submap, not stored yet
  /// @param index    holds its place, but not its features
  /// @param odometry edges between consecutive keyposes
  /// @param graph    keyposes are corrected and verdicts appended here
  /// @param changed  indices of closures that were added or changed
  /// @return true if keyposes were corrected
  bool close(const Submap& newest, const Features& features, const PlaceIndex& index,
             const std::vector<GraphEdge>& odometry, GraphState& graph, std::vector<std::size_t>& changed);

  /// Checks the pairs that are left over the whole session, at most `budget` of them. All submaps are stored.
  bool close_all(const PlaceIndex& index, const std::vector<GraphEdge>& odometry, int budget,
                 GraphState& graph, std::vector<std::size_t>& changed);

 private:
  std::shared_ptr<const CheckedSubmap> load(std::int64_t id, const PlaceIndex& index);
  bool check(std::int64_t to, const Candidate& candidate, const PlaceIndex& index,
             const std::vector<double>& distances, GraphState& graph, std::vector<std::size_t>& changed,
             int& budget);
  int check_further(std::int64_t to, const PlaceIndex& index, int budget, GraphState& graph,
                    std::vector<std::size_t>& changed, int& accepted);
  static void correct(const PlaceIndex& index, const std::vector<GraphEdge>& odometry, GraphState& graph,
                      std::vector<std::size_t>& changed);

  BackendConfig config_;
  const SessionStore& store_;
  std::list<std::shared_ptr<const CheckedSubmap>> recent_;  // newest first
  const Submap* newest_ = nullptr;  // during close(): most submaps have no candidate, so it is copied late
};

}  // namespace hp2
