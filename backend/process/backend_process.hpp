// The back-end on the bus: submaps in, graph and trajectory out, the session on disk.
#pragma once
#include <cstdint>
#include <map>
#include <set>
#include <string>

#include "backend/process/session_worker.hpp"
#include "common/transport/inbox.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/message_loader.hpp"
#include "common/transport/outbox.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/process.hpp"
#include "common/transport/stagnation.hpp"

namespace hp2 {

/// How the back-end behaves on the bus.
struct BackendProcessOptions {
  RunOptions run;
  std::string session_folder;
  bool exit_when_done = false;  ///< End once the session is complete and all viewers have written it.
  std::map<std::string, std::string> meta;  ///< Texts to keep in the session.
};

/// One run of hp2_backend.
class BackendProcess {
 public:
  /// @throws Error if the session cannot be opened
  BackendProcess(LcmBus& bus, const BackendConfig& config, const BackendProcessOptions& options);

  /// To be called every few milliseconds.
  /// @return false after a stop, or when done (see BackendProcessOptions::exit_when_done)
  /// @throws Error if the session cannot be written
  bool tick();
  int exit_status() const { return exit_status_; }

 private:
  void on_snapshot(SessionSnapshot snapshot);
  Submap read_submap(std::int64_t id);
  EncodedMessagePtr resume_message();
  void ask_again(const std::string& why);
  void watch_submaps();
  void believe_viewers();
  void publish_correction();
  void keep_statuses(bool now);
  bool nobody_waits() const;
  bool time_to_go();
  void report();

  LcmBus& bus_;
  BackendProcessOptions options_;
  Endpoint endpoint_;
  Presence presence_;
  Stagnation stagnation_;
  SessionWorker worker_;
  SessionStore reader_;  // read by loader_'s thread alone
  MessageLoader loader_;
  ControlListener control_;
  Inbox submaps_;
  Outbox resume_, graph_, trajectory_, session_submaps_;
  SessionSnapshot now_;
  EncodedMessagePtr resume_message_;  // of `now_`, once a front-end has asked for it
  bool opened_ = false, stop_ = false, stop_all_ = false, finishing_ = false;
  std::int64_t handed_ = 0;  // submaps handed to the worker
  std::int64_t started_us_ = 0, last_correction_us_ = 0, retry_us_ = 0, last_keep_us_ = 0;
  std::int64_t frontend_us_ = 0;  // a front-end was there
  std::map<std::int64_t, std::int64_t>
      done_claims_;                      // who says since when that it has written the whole session
  std::set<std::int64_t> done_viewers_;  // and is believed
  int refusals_ = 0;                     // of the submap that is next, one after another
  std::int64_t written_revision_ = -1;   // a viewer has written its results
  int exit_status_ = 0;
};

}  // namespace hp2
