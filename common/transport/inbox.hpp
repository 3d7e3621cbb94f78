// The reading side: requests pieces, a few at a time, requests lost ones again, checks, drops duplicates, and
// delivers whole messages in order.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/transport/assembly.hpp"
#include "common/transport/endpoint.hpp"

namespace hp2 {

/// A whole message as it is handed up.
struct Delivery {
  std::int64_t id = 0;
  std::shared_ptr<ByteVector> bytes;
  std::int64_t sender_id = 0;
};

/// Reader of the messages of one topic.
class Inbox {
 public:
  enum class Order {
    kAll,     ///< Every message, in order of id.
    kLatest,  ///< The newest message; older ones do not matter.
  };
  struct Options {
    std::string topic;
    Order order = Order::kAll;
    int prefetch = 3;  ///< Messages that may be under way at once.
    std::size_t max_message_bytes = kMaxMessageBytes;
    bool accept_unasked =
        false;  ///< Also pieces that someone publishes without an offer (a recording, an injector).
  };

  /// @param deliver called with whole messages that were asked for, in the bus's thread
  Inbox(Endpoint& endpoint, Options options, std::function<void(Delivery)> deliver);
  ~Inbox();
  Inbox(const Inbox&) = delete;
  Inbox& operator=(const Inbox&) = delete;

  const std::string& topic() const { return options_.topic; }

  /// Continues at message `id`; pieces requested before are forgotten if they do not fit. For kAll: the next
  /// message to be delivered.
  void seek(std::int64_t id);
  std::int64_t next_delivery() const { return next_; }
  /// Requests and acknowledges nothing, but receives offers: the owner must not count on this reader
  /// yet.
  void set_silent(bool silent) { silent_ = silent; }
  /// Fetch only messages before `id`: the consumer has no room for more.
  void set_limit(std::int64_t id);
  /// All messages before `wanted` were used, all before `done` are stored. Reported to the owner.
  void acknowledge(std::int64_t wanted, std::int64_t done);

  /// The owner's last offer while the owner lives (an offer in the last 2 s), nothing otherwise.
  const offer_t* offer() const;
  /// The owner has reported for a moment, without contradiction, that nothing follows.
  bool ended() const;
  /// Pieces of the next message are here or under way.
  bool busy() const { return !assemblies_.empty(); }
  /// The last offer received, whether its owner is alive or not.
  const std::optional<offer_t>& last_offer() const { return offer_; }
  /// Called when the owner's offer changed.
  void on_offer_changed(std::function<void(const offer_t&)> callback) {
    on_offer_changed_ = std::move(callback);
  }
  /// Where unasked whole messages go (see Options::accept_unasked).
  void on_unasked(std::function<void(Delivery)> callback) { on_unasked_ = std::move(callback); }

  /// Bytes held for unasked messages that are not whole yet.
  std::size_t unasked_bytes() const;

  void on_offer(const offer_t& offer);
  void poll();

 private:
  void on_chunk(const std::uint8_t* data, std::size_t size);
  bool take_piece(Assembly& assembly, const ChunkView& piece);
  void take_unasked(const ChunkView& piece);
  void release_unasked();
  bool intact(const Assembly& assembly);
  void drop(std::map<std::int64_t, Assembly>::iterator at);
  void forget_asked(Assembly& assembly);
  void deliver_ready();
  void find_lost();
  void pump();
  void send_fetch(std::int64_t message_id, std::vector<std::int32_t> indices);

  Endpoint& endpoint_;
  Options options_;
  std::function<void(Delivery)> deliver_, on_unasked_;
  std::function<void(const offer_t&)> on_offer_changed_;
  std::optional<offer_t> offer_;
  std::int64_t offer_heard_us_ = 0, ended_since_us_ = 0;
  std::map<std::int64_t, Assembly> assemblies_;
  std::map<std::pair<std::int64_t, std::int64_t>, Assembly> unasked_;  // by (sender, message)
  std::int64_t next_ = 0, limit_ = std::int64_t{1} << 62, wanted_ = 0, done_ = 0;
  std::int64_t asks_ = 0, last_fetch_us_ = 0;
  bool acknowledge_now_ = false, silent_ = false;
};

}  // namespace hp2
