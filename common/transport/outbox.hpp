// The owner's side: offers its messages and answers requests. It keeps no list of its readers.
#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/transport/endpoint.hpp"

namespace hp2 {

/// The bytes of a message, ready to be cut into pieces.
struct EncodedMessage {
  explicit EncodedMessage(ByteVector encoded);
  /// @param sum CRC-32 of the bytes
  EncodedMessage(ByteVector encoded, std::uint32_t sum);
  ByteVector bytes;
  std::uint32_t crc = 0;
  int pieces = 1;
  std::vector<bool> sent;  ///< Which pieces were sent before; only the bus's thread touches it.
};
using EncodedMessagePtr = std::shared_ptr<EncodedMessage>;

/// A reader's claim of how far it is. A claim beyond what this process has sent may be true, if its
/// predecessor sent it: it counts once it was repeated for a while without contradiction. One foreign
/// datagram has no effect.
class Claim {
 public:
  /// @param possible what can be true at once: one past the last message sent
  void hear(std::int64_t value, std::int64_t possible, std::int64_t now_us);
  /// The accepted value.
  std::int64_t value() const { return value_; }
  /// There is a claim that is not accepted yet.
  bool pending() const { return pending_ >= 0; }

 private:
  std::int64_t value_ = 0, pending_ = -1, since_us_ = 0;
};

/// Owner of the messages of one topic.
class Outbox {
 public:
  /// Gives message `id`, which lies in the offered range. Empty: not ready yet, ask again soon. Must not
  /// block.
  using Provider = std::function<EncodedMessagePtr(std::int64_t id)>;

  Outbox(Endpoint& endpoint, std::string topic, Provider provider);
  ~Outbox();
  Outbox(const Outbox&) = delete;
  Outbox& operator=(const Outbox&) = delete;

  const std::string& topic() const { return topic_; }
  /// What can be fetched: ids in [first, next). Published at once if it differs from before, and 4 times a
  /// second.
  void offer(std::int64_t first, std::int64_t next, bool ended, std::int8_t pacing = offer_t::LOCKSTEP);
  /// Forgets the readers' claims: the messages are numbered from the beginning.
  void forget_readers();
  /// For pieces sent without a session, so that a recording of them can be played into any session.
  void send_for_any_session() { any_session_ = true; }

  std::int64_t first() const { return offer_.first_id; }
  std::int64_t next() const { return offer_.next_id; }
  /// All messages before it are stored, as far as any reader has reported.
  std::int64_t done_id() const { return done_id_; }
  /// A reader has reported that its session is over and that it needs nothing more.
  bool over() const { return over_; }
  /// The last reader's next wish; may lie beyond what is offered.
  std::int64_t wanted_id() const { return wanted_.value(); }
  /// A reader's claim about messages that were not sent to it is pending.
  bool wish_pending() const { return wanted_.pending(); }
  /// One past the last message that was sent to the last piece, or in part.
  std::int64_t sent_end() const { return sent_end_; }
  /// Process that fetched last, and when [us]; 0: nobody yet.
  std::int64_t reader_id() const { return reader_id_; }
  std::int64_t heard_us() const { return heard_us_; }
  /// Called with every fetch that this outbox answers, before it does.
  void on_reader(std::function<void(const fetch_t&)> callback) { on_reader_ = std::move(callback); }

  void on_fetch(const fetch_t& fetch);
  void poll();

 private:
  struct Request {
    std::int64_t message_id = 0;
    std::vector<std::int32_t> indices;
    std::int64_t since_us = 0;
  };
  bool answer(const Request& request);
  void answer_waiting();
  void send_piece(std::int64_t id, EncodedMessage& message, int index);
  void publish_offer();

  Endpoint& endpoint_;
  std::string topic_;
  Provider provider_;
  std::function<void(const fetch_t&)> on_reader_;
  offer_t offer_;
  bool offered_ = false, any_session_ = false, over_ = false;
  Claim done_, wanted_;
  std::int64_t sent_end_ = 0;
  std::int64_t last_offer_us_ = 0;
  std::int64_t done_id_ = 0, reader_id_ = 0, heard_us_ = 0;
  std::deque<Request> waiting_;                          // in order of id, the first one not ready yet
  std::deque<std::pair<std::int64_t, int>> everything_;  // (message, piece) of requests for all pieces
};

}  // namespace hp2
