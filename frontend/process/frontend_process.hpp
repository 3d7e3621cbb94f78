// The front-end on the bus: scans from the player or a live sensor in, odometry and submaps out, its state
// kept by the back-end so that it can die at any moment.
#pragma once
#include <cstdint>
#include <optional>
#include <string>

#include "common/transport/inbox.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/process.hpp"
#include "common/transport/stagnation.hpp"
#include "frontend/process/kept_submaps.hpp"
#include "frontend/process/live_scans.hpp"
#include "frontend/process/registration_worker.hpp"

namespace hp2 {

/// How the front-end behaves on the bus.
struct FrontendProcessOptions {
  RunOptions run;
  int threads = 2;
  bool standalone = false;    ///< Begin without a back-end: odometry only, submaps are dropped.
  int live_backlog = 4;       ///< Live scans that may wait; beyond that the oldest are dropped.
  int real_time_backlog = 2;  ///< Scans of a real-time player that may wait before the newest is taken.
};

/// One run of hp2_frontend.
class FrontendProcess {
 public:
  FrontendProcess(LcmBus& bus, const FrontendConfig& config, const FrontendProcessOptions& options);

  /// To be called every few milliseconds.
  /// @return false when the session is over and stored
  /// @throws Error if the session cannot be joined, or another front-end runs it already
  bool tick();
  int exit_status() const { return exit_status_; }

 private:
  enum class State { kWaiting, kRunning, kEnding, kOver };

  void on_command(const control_t& command, bool named);
  void on_resume(const Delivery& delivery);
  void begin(std::int64_t next_submap, std::int64_t next_sequence, const std::vector<std::uint8_t>& state);
  void on_scan(Delivery delivery);
  void feed();
  void feed_live();
  void skip_to_newest();
  void on_event(RegistrationEvent event);
  void publish(const OdometryResult& result);
  void check_backend();
  void check_twin() const;
  void end_session(const std::string& why);
  bool over();
  void report();

  LcmBus& bus_;
  FrontendProcessOptions options_;
  Endpoint endpoint_;
  Presence presence_;
  ControlListener control_;
  Inbox resume_, scans_;
  KeptSubmaps submaps_;
  LiveScans live_;
  RegistrationWorker worker_;
  Stagnation stagnation_;

  State state_ = State::kWaiting;
  bool paused_ = false, stop_ = false;
  std::int64_t started_us_ = 0, generation_ = 0;
  int in_worker_ = 0;               // scans handed to the worker that have not come back
  std::int64_t next_sequence_ = 0;  // one past the last registered scan
  std::int64_t last_given_ = -1;    // last sequence number handed to the worker
  std::int64_t odometry_number_ = 0;
  std::int64_t behind_since_us_ = 0;  // the back-end has less than it confirmed, since
  std::int64_t over_since_us_ = 0;
  std::int64_t silent_player_us_ = 0;  // its offers did not come
  int exit_status_ = 0;
};

}  // namespace hp2
