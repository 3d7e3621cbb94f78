// The side that has messages: says what there is, and answers who asks. It keeps no list of its readers.
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

/// How far a reader says that it is. What goes beyond what this process has sent may be true, if its
/// predecessor sent it: it counts once it was said for a while and nobody said otherwise. One foreign
/// datagram ends nothing.
class Claim {
 public:
  /// @param possible what can be true at once: one past the last message sent
  void hear(std::int64_t value, std::int64_t possible, std::int64_t now_us);
  /// What is believed.
  std::int64_t value() const { return value_; }
  /// Something was said that is not believed yet.
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
  /// Forgets what readers have said: the messages are numbered anew.
  void forget_readers();
  /// For pieces sent without a session, so that a recording of them can be played into any session.
  void send_for_any_session() { any_session_ = true; }

  std::int64_t first() const { return offer_.first_id; }
  std::int64_t next() const { return offer_.next_id; }
  /// All messages before it are done with for good, as far as any reader said.
  std::int64_t done_id() const { return done_id_; }
  /// A reader said that its session is over and that it wants nothing any more.
  bool over() const { return over_; }
  /// The last reader's next wish; may lie beyond what is offered.
  std::int64_t wanted_id() const { return wanted_.value(); }
  /// A reader wishes for what was not sent to it, and is not believed yet.
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
