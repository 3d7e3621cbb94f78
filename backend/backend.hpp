// The back-end as its process and the tests use it: finished submaps in, a corrected graph out. No LCM here.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "backend/backend_config.hpp"
#include "common/session.hpp"
#include "common/session/session_store.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// What a submap changed.
struct BackendUpdate {
  std::vector<ClosureRecord> new_verdicts;  ///< On the candidates that this submap brought.
  bool graph_changed = false;               ///< Keyposes other than the new one moved.
  double ms_total = 0.0;                    ///< Time spent [ms].
};

/// Loop closing and the pose graph over the submaps of one session. Keeps no submap's points in memory.
class Backend {
 public:
  /// Takes up the session that `store` holds: graph and closures as stored, the place index rebuilt from
  /// stored descriptors.
  Backend(const BackendConfig& config, SessionStore& store);
  ~Backend();

  /// Stores the submap with all that it brings (descriptors, verdicts, corrected graph) in one transaction. A
  /// submap that is stored already is ignored.
  /// @param frontend_state the front-end's state at the submap's end (Frontend::save_state)
  /// @param last           the session ends with it
  /// @throws Error if the disk is full or the session cannot be written; the session is then as before the
  /// call
  BackendUpdate add_submap(const Submap& submap, const std::vector<std::uint8_t>& frontend_state, bool last);

  /// Final optimisation and scan-level refinement over the whole session; stores and marks it as ended.
  BackendUpdate finish();

  /// The graph as it stands. `trajectory` is filled too.
  const GraphState& graph() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hp2
