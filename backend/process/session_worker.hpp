// The back-end's work outside the bus's thread: submaps are added to the session one after another, and each
// gives a snapshot of all that other processes may request.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "backend/backend.hpp"
#include "common/transport/inbox.hpp"
#include "common/transport/outbox.hpp"

namespace hp2 {

/// The session after a change, encoded.
struct SessionSnapshot {
  std::int64_t submap_count = 0;
  std::int64_t next_sequence = 0;  ///< First scan that is in no stored submap.
  std::int64_t revision = 0;
  bool last_stored = false;  ///< No submap will follow.
  bool ended = false;        ///< Refined, too.
  std::string rejected;      ///< Why the submap that was handed over was not taken; nothing changed then.
  resume_t resume;           ///< Without the front-end's state, which is large and rarely requested.
  std::shared_ptr<const std::vector<std::uint8_t>> frontend_state;
  EncodedMessagePtr graph, trajectory;
  Pose map_from_odom;
  std::vector<closure_t> new_closures;
};

/// Owns the session, and does all work on it in a thread of its own, at a lower priority than the
/// front-end's. `sink` receives snapshots from that thread, the first one right after construction.
class SessionWorker {
 public:
  /// @throws Error if the session cannot be opened
  /// @param session_id that a new session gets, and a stored one must have; 0: any
  SessionWorker(const std::string& folder, const BackendConfig& config, std::int64_t session_id,
                std::function<void(SessionSnapshot)> sink);
  ~SessionWorker();
  SessionWorker(const SessionWorker&) = delete;
  SessionWorker& operator=(const SessionWorker&) = delete;

  std::int64_t session_id() const { return session_id_; }
  /// An encoded submap, to be stored next.
  void add(Delivery submap);
  /// No submap will follow: optimise and refine the whole.
  void finish();
  /// Keeps small texts in the session (see SessionStore::write_meta).
  void write_meta(std::map<std::string, std::string> values);
  /// Work is in hand or waits.
  bool busy();
  /// Rethrows an error of the thread (disk full, a session that cannot be written), if there was one.
  void rethrow_error();

 private:
  void work();
  bool store(const Delivery& delivery);
  SessionSnapshot snapshot();

  SessionStore store_;
  Backend backend_;
  const std::int64_t session_id_;
  std::function<void(SessionSnapshot)> sink_;
  std::size_t closures_told_ = 0;
  std::shared_ptr<const std::vector<std::uint8_t>> frontend_state_;  // as stored last

  std::mutex mutex_;
  std::condition_variable wake_;
  std::deque<std::function<bool()>> jobs_;  // return whether the session changed
  std::exception_ptr error_;
  bool stop_ = false, working_ = false;
  std::thread thread_;
};

}  // namespace hp2
