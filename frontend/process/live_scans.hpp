// Scans published without a handshake: by a sensor's driver on HP2_SCAN, or by a replayed recording in
// pieces.
#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>

#include "common/transport/endpoint.hpp"
#include "frontend/process/scan_checks.hpp"
#include "frontend/process/scan_streams.hpp"

namespace hp2 {

/// Numbers live scans and keeps the newest. Belongs to the bus's thread.
class LiveScans {
 public:
  using Warn = std::function<void(const std::string& text)>;

  /// @param backlog scans that may wait; beyond that the oldest are dropped and counted
  /// @param warn    takes remarks for the user, one of each kind
  LiveScans(Endpoint& endpoint, int backlog, Warn warn);

  /// Why live scans are refused now, as text; empty: they are taken.
  void refuse(const std::string& why) { refused_because_ = why; }
  /// The front-end continues at this sequence number: live scans get this number and those after it.
  void set_next_sequence(std::int64_t next) { streams_.set_next(next); }
  /// A whole encoded message. @param sender number of the process that sent it; 0: not known
  void take(const std::uint8_t* data, std::size_t size, std::int64_t sender);
  /// To be called every few milliseconds: scans held back may have their turn.
  void poll();
  /// The oldest scan that waits.
  std::optional<Scan> pop();
  bool empty() const { return queue_.empty(); }
  /// A scan came in the last 2 s.
  bool active() const;

 private:
  void queue(std::vector<Scan> scans);
  void check_size(std::size_t size);

  Endpoint& endpoint_;
  const std::size_t backlog_;
  Warn warn_;
  std::string refused_because_ = "the session has not begun yet";
  std::string told_refusal_;
  bool told_size_ = false;
  ScanStreams streams_;
  ScanChecks checks_;
  std::deque<Scan> queue_;
  std::size_t held_ = 0;  // of the queue: scans that came at once, after they had been held back
};

}  // namespace hp2
