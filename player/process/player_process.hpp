// The player on the bus: offers the scans of a drive in lockstep or by the clock, and ends when all of them
// are safe.
#pragma once
#include <cstdint>
#include <vector>

#include "common/transport/message_loader.hpp"
#include "common/transport/outbox.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/process.hpp"
#include "common/transport/stagnation.hpp"
#include "player/process/progress.hpp"
#include "player/scan_source.hpp"

namespace hp2 {

/// How the drive is played.
struct PlayerOptions {
  RunOptions run;
  double rate = 0.0;  ///< Times real time; 0: lockstep, as fast as the front-end registers.
  bool start_paused = false;
  int threads = 1;  ///< Threads that read ahead.
  int ahead = 8;    ///< Scans kept ready.
};

/// One run of hp2_player. Scans are sent for any session, so that a recording of them can be played into any.
class PlayerProcess {
 public:
  /// `source` must outlive the process.
  PlayerProcess(Bus& bus, const ScanSource& source, const PlayerOptions& options);

  /// To be called every few milliseconds.
  /// @return false when the run is over: every scan is safe, the front-end ended the session, or a stop came
  /// @throws Error if a scan cannot be read
  bool tick();
  /// 0 if every scan is safe or the session was ended by its front-end or a command to all, 130 after a stop
  /// of the player alone.
  int exit_status() const { return exit_status_; }

 private:
  void on_command(const control_t& command, bool named);
  void offer();
  void turn_clock();
  std::int64_t registered() const;
  std::int64_t due(std::int64_t index) const;
  void report();
  void report_damage();
  bool nobody_asks() const;
  bool end(int status, const std::string& text);

  Bus& bus_;
  const ScanSource& source_;
  PlayerOptions options_;
  std::int64_t total_;
  Endpoint endpoint_;
  Presence presence_;
  ControlListener control_;
  MessageLoader loader_;
  Outbox outbox_;
  Progress progress_;
  Stagnation stagnation_;
  bool paused_, stop_ = false, stop_all_ = false;
  std::int64_t allowed_ = 0;   // while paused: scans before it may be sent
  std::int64_t appeared_ = 0;  // real time: scans before it have appeared
  std::int64_t clock_start_us_ = -1, clock_base_us_ = 0, last_tick_us_ = 0;
  std::int64_t session_ended_us_ = 0;  // the back-end has reported it since; 0: it has not
  std::vector<std::int64_t> due_us_;   // when scans appear, long gaps cut short
  std::size_t damaged_ = 0;
  int exit_status_ = 0;
};

}  // namespace hp2
