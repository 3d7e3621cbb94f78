// One process's part in the protocol: its id, its session, and its outboxes and inboxes, to which it passes
// the offers and fetches received.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "common/transport/bus.hpp"
#include "common/transport/convert.hpp"

namespace hp2 {

class Inbox;
class Outbox;

/// Named counts, for STATUS. Names are in status order of first use by name.
using Counters = std::map<std::string, std::int64_t>;

/// Not thread-safe: belongs to the bus's thread.
class Endpoint {
 public:
  /// Draws a random sender id.
  explicit Endpoint(Bus& bus);
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;

  Bus& bus() { return bus_; }
  std::int64_t sender_id() const { return sender_id_; }
  /// 0 until it is known.
  std::int64_t session_id() const { return session_id_; }
  void set_session(std::int64_t session_id);
  /// Take over the session of the first offer received on one of these topics.
  void adopt_session_from(std::set<std::string> topics) { adopt_from_ = std::move(topics); }
  /// A session that is silent for 5 s is left for another one offered on these topics, while `nothing_begun`
  /// says that none of its messages was used.
  void leave_silent_session(std::function<bool()> nothing_begun) {
    nothing_begun_ = std::move(nothing_begun);
  }
  /// Calls `callback` with every offer of this session on `topic`, whose messages this process does not
  /// fetch.
  void watch_offers(const std::string& topic, std::function<void(const offer_t&)> callback) {
    watchers_[topic] = std::move(callback);
  }

  /// This sender offers its messages in another session.
  bool is_foreign(std::int64_t sender_id) const { return foreign_senders_.count(sender_id) != 0; }

  Counters& counters() { return counters_; }
  /// Counts a message that was refused and logs why, at most once a second.
  void reject(const std::string& channel, const std::string& why);

  template <class T>
  void publish(const std::string& channel, const T& message) {
    const auto bytes = encode_message(message);
    bus_.publish(channel, bytes.data(), bytes.size());
  }

  /// Timers of all boxes; to be called every few milliseconds.
  void poll();

  /// How many pieces of kPieceBytes may be under way to this process at once, over all its inboxes. Halved
  /// when pieces are lost, grows back while none are.
  int free_window() const { return window_ - in_flight_; }
  /// A third of the window is free: pieces are asked for so many at a time, as every request wakes their
  /// owner.
  bool may_ask() const { return free_window() >= std::max(1, window_ / 3); }
  void piece_asked() { ++in_flight_; }
  void piece_settled() { --in_flight_; }
  void window_loss();
  void window_success();

 private:
  friend class Inbox;
  friend class Outbox;
  void on_offer(const std::uint8_t* data, std::size_t size);
  void on_fetch(const std::uint8_t* data, std::size_t size);

  Bus& bus_;
  std::int64_t sender_id_ = 0;
  std::int64_t session_id_ = 0;
  std::set<std::string> adopt_from_;
  std::function<bool()> nothing_begun_;
  std::set<std::int64_t> foreign_senders_;
  std::int64_t own_session_heard_us_ = 0;
  std::map<std::string, std::function<void(const offer_t&)>> watchers_;
  std::vector<Outbox*> outboxes_;
  std::vector<Inbox*> inboxes_;
  Counters counters_;
  std::int64_t last_reject_log_us_ = 0;
  std::int64_t last_other_session_log_us_ = 0;
  int max_window_ = 2, window_ = 2, in_flight_ = 0, successes_ = 0;
  std::int64_t last_loss_us_ = 0;
};

/// A random number in [1, 2^62): for sender and session ids.
std::int64_t random_id();

}  // namespace hp2
