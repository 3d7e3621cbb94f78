// Every process publishes its status twice per second and receives that of the others.
#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "common/transport/endpoint.hpp"

namespace hp2 {

/// What a process says of itself.
struct Report {
  std::int8_t state = status_t::WAITING;
  std::string text;         ///< What it does or waits for, in words.
  std::int64_t done = 0;    ///< Scans, submaps or files.
  std::int64_t total = -1;  ///< -1: not known.
};

/// Another process, as it spoke last.
struct Peer {
  status_t status;
  std::int64_t heard_us = 0;
  int times = 0;  ///< Number of its messages received.
  std::int64_t first_us = 0;
  /// It sent more than one STATUS over a moment: anybody can send one.
  bool established() const { return times > 1 && heard_us - first_us >= 300'000; }
};

/// Publishes STATUS and keeps the others' last words. Belongs to the bus's thread.
class Presence {
 public:
  /// @param process name, e.g. "hp2_frontend"
  Presence(Endpoint& endpoint, std::string process);

  /// Takes the new report; a change of state or text is published at once and logged.
  void set(const Report& report);
  const Report& report() const { return report_; }
  /// A remark on the data for the user: logged, and repeated in STATUS ("warning: ..."), so that a viewer
  /// that starts late receives it, too.
  void warn(const std::string& text);
  /// Remarks of all processes, in order of arrival, each once.
  const std::vector<std::string>& warnings() const { return all_warnings_; }
  /// `done` per second over the last 3 seconds.
  double rate() const;
  /// Publishes what is due. @param force publishes now
  void poll(bool force = false);

  /// Processes whose STATUS was received, by sender id; at most 64. Those of other sessions are forgotten
  /// first, then those received once, then the longest silent ones.
  const std::map<std::int64_t, Peer>& peers() const { return peers_; }
  /// Processes `name` of this session that sent STATUS in the last 1.5 s and have not reported their end,
  /// other than this one.
  std::vector<const Peer*> all_live(const std::string& name) const;
  /// One of them; null if there is none.
  const Peer* live(const std::string& name) const;
  /// Processes `name` of this session that may come back: they have not reported their end, sent something in
  /// the last 30 s (a link may be down that long), and are not known to be dead. The death of a process on
  /// this machine is known.
  std::vector<const Peer*> all_missed(const std::string& name) const;
  /// Whether the sender of an offer may come back, as above; also one whose STATUS has not come yet.
  bool missed(std::int64_t sender_id) const;
  /// Whether the sender of an offer is still there, even if it hangs: it has not reported its end, and its
  /// process exists. One on another machine counts as gone after 30 s of silence.
  bool may_return(std::int64_t sender_id) const;
  /// This process's own status as it stands.
  status_t status() const;
  std::int64_t now_us() const { return endpoint_.bus().now_us(); }
  /// Number of STATUS messages sent.
  std::int64_t number() const { return number_; }

 private:
  void on_status(const std::uint8_t* data, std::size_t size);
  bool missed(const Peer& peer) const;
  bool exists(const Peer& peer) const;

  Endpoint& endpoint_;
  std::string process_, host_;
  Report report_;
  std::vector<std::string> warnings_, all_warnings_;
  std::size_t told_ = 0;  // warnings that have been sent
  std::int64_t number_ = 0, last_us_ = 0;
  std::deque<std::pair<std::int64_t, std::int64_t>> history_;  // (time, done)
  std::map<std::int64_t, Peer> peers_;
};

}  // namespace hp2
