// The session on disk: an SQLite database in WAL mode, one transaction per submap, so that a crash loses at
// most the submap in flight.
#pragma once
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// What one transaction brings to the session. Pointers may be null: nothing of that kind.
struct SessionChange {
  const Submap* submap = nullptr;                             ///< New submap; its id is submap_count().
  bool last = false;                                          ///< The session ends with `submap`.
  const std::vector<std::uint8_t>* frontend_state = nullptr;  ///< Replaces the stored one.
  const std::vector<std::uint8_t>* place = nullptr;           ///< Place description of `submap`; opaque here.
  const GraphState* graph = nullptr;          ///< Keyposes, revision, flags, and of the rest ...
  std::vector<std::size_t> changed_closures;  ///< ... these indices into graph->closures,
  std::int64_t moved_from = 0;                ///< final poses of the submaps from this one on,
  std::size_t new_edges_from = 0;             ///< and odometry edges from this index on.
};

/// Name of the text in write_meta() that says "yes" if the scans of an ended session are smoothed.
inline constexpr const char* kScansSmoothed = "scans_smoothed";
/// Name of the text that says which revision of an ended session a viewer has written the results of.
inline constexpr const char* kResultsWritten = "results_written";

/// What becomes of damage when a session is read.
enum class OnDamage {
  kThrow,     ///< DamageError.
  kLeaveOut,  ///< Damaged records are left out, with a message.
};

/// A session folder: `session.sqlite` in it. Everything that the viewer needs offline can be read from it;
/// nothing is computed here. Not thread-safe; any number of readers in other processes may read at the same
/// time.
class SessionStore {
 public:
  enum class Access { kReadWrite, kReadOnly };

  /// Opens the session in `folder`, creating both unless read-only.
  /// @throws Error if the folder cannot be written, the file is no session, is damaged, or is of another
  /// version
  /// @param session_id that a new session gets, and a stored one must have; 0: any
  explicit SessionStore(const std::string& folder, Access access = Access::kReadWrite,
                        std::int64_t session_id = 0);
  ~SessionStore();
  SessionStore(const SessionStore&) = delete;
  SessionStore& operator=(const SessionStore&) = delete;

  /// Identity of the session, a positive random number given when it was created.
  std::int64_t session_id() const;
  /// Number of stored submaps: ids 0 .. n-1.
  std::int64_t submap_count() const;
  /// One stored submap. Exact but for normals of more than 8 bits (kept to 1/127).
  /// @param with_points false: `points`, `normals` and `scan_indices` stay empty
  /// @throws Error if there is none with that id; DamageError if it is damaged
  Submap read_submap(std::int64_t id, bool with_points = true) const;
  /// What is left of a submap: the keypose is the identity, scans or points are missing, where these are
  /// damaged.
  /// @param said what is missing, in words, is appended
  Submap read_what_is_left(std::int64_t id, std::vector<std::string>& said) const;
  /// Place description stored with a submap; empty if there is none. What is in it has a checksum of its own.
  std::vector<std::uint8_t> read_place(std::int64_t id) const;
  /// Replaces a place description that was damaged, or of an older version.
  void write_place(std::int64_t id, const std::vector<std::uint8_t>& place);
  /// The front-end's state after the newest submap; empty if there is none. @throws DamageError
  std::vector<std::uint8_t> read_frontend_state() const;
  /// The last stored graph with all closures, odometry edges and the trajectory; a graph of no nodes if
  /// nothing is stored. Edges and trajectory can be computed again: damaged, or not stored by an older
  /// version, they are empty.
  /// @param said what was left out, in words, is appended; may be null
  /// @throws DamageError for keyposes and closures, unless they are to be left out
  GraphState read_graph(OnDamage on_damage = OnDamage::kThrow,
                        std::vector<std::string>* said = nullptr) const;
  /// True once the last submap of the session is stored.
  bool last_submap_stored() const;
  /// True once the session has ended and a viewer has written its results. (Older sessions do not record it;
  /// they count as written.)
  bool results_written() const;
  /// Small named texts: configuration, versions, data set, per-process summaries. Names given before are
  /// replaced.
  void write_meta(const std::map<std::string, std::string>& values);
  std::map<std::string, std::string> read_meta() const;

  /// Writes all of `change`, or nothing.
  /// @throws Error if the disk is full or the session cannot be written; it is then as before the call
  void commit(const SessionChange& change);
  /// Largest size the database may grow to [bytes]; 0: no limit but the disk. Writing beyond it is as a full
  /// disk.
  void limit_size(std::int64_t bytes);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hp2
