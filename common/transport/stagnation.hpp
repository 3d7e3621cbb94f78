// No process waits for ever without a message that says for whom.
#pragma once
#include <cstdint>
#include <string>

#include "common/transport/presence.hpp"

namespace hp2 {

/// Watches whether anything happens in this process's session. Every 30 s without progress it logs a line
/// that says for whom the process waits, and at last ends it with that line.
class Stagnation {
 public:
  /// @param give_up_after_s seconds without progress after which tick() throws; 0: never
  Stagnation(Endpoint& endpoint, const Presence& presence, double give_up_after_s);

  /// To be called with every tick, after the report. Progress is: work in hand, here or in another process of
  /// the session; another `done` of one of them; a process that comes or goes.
  /// @param busy this process has work in hand
  /// @param idle it waits for nothing: it serves readers, or was paused
  /// @throws Error when nothing has happened for so long
  void tick(bool busy, bool idle = false);
  /// The message of tick(): time without progress, what this process waits for, the other processes.
  std::string line() const;

 private:
  std::uint64_t signature(bool& others_work) const;

  Endpoint& endpoint_;
  const Presence& presence_;
  std::int64_t give_up_after_us_;
  std::uint64_t signature_ = 0;
  std::int64_t last_us_ = 0, nothing_us_ = 0, said_us_ = 0;
};

}  // namespace hp2
