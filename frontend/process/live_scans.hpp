// Scans that somebody publishes without a handshake: a sensor's driver on HP2_SCAN, a replayed recording in
// pieces.
#pragma once
#include <cstdint>
#include <deque>
#include <optional>

#include "common/transport/endpoint.hpp"
#include "common/transport/inbox.hpp"

namespace hp2 {

/// Numbers live scans and keeps the newest. Belongs to the bus's thread.
class LiveScans {
 public:
  /// @param backlog scans that may wait; beyond that the oldest are dropped and counted
  LiveScans(Endpoint& endpoint, int backlog);

  /// Live scans are taken only while nobody offers scans.
  void allow(bool allowed) { allowed_ = allowed; }
  /// The front-end goes on at this sequence number: live scans get this number and those after it.
  void set_next_sequence(std::int64_t next) { next_ = next; }
  /// A replayed message.
  void take(const std::uint8_t* data, std::size_t size);
  /// The oldest scan that waits.
  std::optional<Scan> pop();
  bool empty() const { return queue_.empty(); }
  /// A scan came in the last 2 s.
  bool active() const;

 private:
  Endpoint& endpoint_;
  const std::size_t backlog_;
  bool allowed_ = false;
  std::deque<Scan> queue_;
  std::int64_t next_ = 0;    // number of the next scan that is not numbered
  std::int64_t offset_ = 0;  // from the stream's own numbers to the session's
  std::int64_t last_us_ = 0, last_refused_us_ = 0;
};

}  // namespace hp2
