// The session on disk: an SQLite database in WAL mode, one transaction a submap, so that a crash loses at most the submap in flight.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// A session folder: `session.sqlite` in it. Everything that the viewer needs offline can be read from it.
class SessionStore {
 public:
  enum class Access { kReadWrite, kReadOnly };

  /// Opens the session in `folder`, creating both unless read-only.
  /// @throws Error if the folder cannot be written, the file is no session, is damaged, or is of another version
  SessionStore(const std::string& folder, Access access = Access::kReadWrite);
  ~SessionStore();
  SessionStore(const SessionStore&) = delete;
  SessionStore& operator=(const SessionStore&) = delete;

  /// Identity of the session, a positive random number given when it was created.
  std::int64_t session_id() const;
  /// Number of stored submaps: ids 0 .. n-1.
  std::int64_t submap_count() const;
  /// One stored submap with its points. @throws Error if there is none with that id, or the file is damaged
  Submap read_submap(std::int64_t id) const;
  /// The front-end's state after the newest submap; empty if there is none.
  std::vector<std::uint8_t> read_frontend_state() const;
  /// The last stored graph with all closures and the trajectory; a graph of no nodes if nothing is stored.
  GraphState read_graph() const;
  /// True once the last submap of the session is stored.
  bool last_submap_stored() const;
  /// Small named texts: configuration, versions, data set, per-process summaries.
  void write_meta(const std::map<std::string, std::string>& values);
  std::map<std::string, std::string> read_meta() const;

  // Used by Backend; see backend.cpp.
  class Transaction;

 private:
  friend class Backend;
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hp2
