#include "common/transport/outbox.hpp"

#include <algorithm>
#include <utility>

#include "common/error.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/crc32.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kOfferPeriodUs = 250'000;
constexpr std::int64_t kForgetRequestUs = 2'000'000;
constexpr std::size_t kMostWaiting = 16;
constexpr std::size_t kMostIndices = 64;
constexpr int kUnaskedPiecesATick = 2;
constexpr std::int64_t kBelievedAfterUs = 200'000;  // readers repeat themselves 4 times a second

}  // namespace

void Claim::hear(std::int64_t value, std::int64_t possible, std::int64_t now_us) {
  if (value <= std::max(value_, possible)) {
    value_ = value;
    pending_ = -1;
    return;
  }
  if (!pending()) since_us_ = now_us;
  pending_ = pending() ? std::min(pending_, value) : value;
  if (now_us - since_us_ < kBelievedAfterUs) return;
  value_ = pending_;
  pending_ = -1;
}

EncodedMessage::EncodedMessage(ByteVector encoded) : EncodedMessage(std::move(encoded), 0) {
  crc = crc32(bytes.data(), bytes.size());
}

EncodedMessage::EncodedMessage(ByteVector encoded, std::uint32_t sum)
    : bytes(std::move(encoded)),
      crc(sum),
      pieces(std::max(1, static_cast<int>((bytes.size() + kPieceBytes - 1) / kPieceBytes))),
      sent(static_cast<std::size_t>(pieces), false) {
  if (bytes.size() <= kMaxMessageBytes) return;
  throw Error("a message is too large to be sent",
              std::to_string(bytes.size() >> 20U) + " MiB; at most " +
                  std::to_string(kMaxMessageBytes >> 20U) + " MiB go into one (kMaxMessageBytes)",
              "Use fewer points a scan, shorter submaps or a larger voxel_size_m.");
}

Outbox::Outbox(Endpoint& endpoint, std::string topic, Provider provider)
    : endpoint_(endpoint), topic_(std::move(topic)), provider_(std::move(provider)) {
  offer_.first_id = offer_.next_id = 0;
  offer_.ended = 0;
  offer_.pacing = offer_t::LOCKSTEP;
  endpoint_.outboxes_.push_back(this);
}

Outbox::~Outbox() {
  auto& all = endpoint_.outboxes_;
  all.erase(std::remove(all.begin(), all.end(), this), all.end());
}

void Outbox::offer(std::int64_t first, std::int64_t next, bool ended, std::int8_t pacing) {
  const bool changed = !offered_ || first != offer_.first_id || next != offer_.next_id ||
                       ended != (offer_.ended != 0) || pacing != offer_.pacing;
  offer_.first_id = first;
  offer_.next_id = next;
  offer_.ended = ended ? 1 : 0;
  offer_.pacing = pacing;
  offered_ = true;
  if (changed) publish_offer();
}

void Outbox::forget_readers() {
  done_id_ = reader_id_ = heard_us_ = sent_end_ = 0;
  done_ = wanted_ = Claim();
  over_ = false;
  waiting_.clear();
  everything_.clear();
}

void Outbox::publish_offer() {
  if (endpoint_.session_id() == 0) return;
  offer_.utime = endpoint_.bus().wall_us();
  offer_.session_id = endpoint_.session_id();
  offer_.sender_id = endpoint_.sender_id();
  offer_.topic = topic_;
  last_offer_us_ = endpoint_.bus().now_us();
  endpoint_.publish(kOfferChannel, offer_);
}

void Outbox::on_fetch(const fetch_t& fetch) {
  if (!offered_) return;
  reader_id_ = fetch.sender_id;
  heard_us_ = endpoint_.bus().now_us();
  wanted_.hear(fetch.wanted_id, sent_end_, heard_us_);
  done_.hear(fetch.done_id, sent_end_, heard_us_);
  done_id_ = std::max(done_id_, std::min(done_.value(), offer_.next_id));
  over_ = over_ || done_.value() >= fetch_t::ALL;
  if (on_reader_) on_reader_(fetch);
  if (fetch.n == 0 || fetch.message_id < offer_.first_id || fetch.message_id >= offer_.next_id) return;
  Request request{fetch.message_id, fetch.indices, endpoint_.bus().now_us()};
  if (request.indices.size() > kMostIndices) request.indices.resize(kMostIndices);
  const auto at = std::find_if(waiting_.begin(), waiting_.end(),
                               [&](const Request& r) { return r.message_id >= request.message_id; });
  if (at != waiting_.end() && at->message_id == request.message_id)
    *at = std::move(request);
  else
    waiting_.insert(at, std::move(request));
  if (waiting_.size() > kMostWaiting) waiting_.pop_back();
  answer_waiting();
}

// In order of the messages: what a recording of them plays back has no other order than theirs.
void Outbox::answer_waiting() {
  while (!waiting_.empty()) {
    const std::int64_t id = waiting_.front().message_id;
    const bool offered = id >= offer_.first_id && id < offer_.next_id;
    const bool forgotten = endpoint_.bus().now_us() - waiting_.front().since_us > kForgetRequestUs;
    if (offered && !forgotten && !answer(waiting_.front())) return;
    waiting_.pop_front();
  }
}

bool Outbox::answer(const Request& request) {
  const auto message = provider_(request.message_id);
  if (!message) return false;
  for (const auto index : request.indices) {
    if (index == -1) {
      everything_.clear();
      for (int i = 0; i < message->pieces; ++i) everything_.emplace_back(request.message_id, i);
    } else if (index >= 0 && index < message->pieces) {
      send_piece(request.message_id, *message, index);
    }
  }
  return true;
}

void Outbox::send_piece(std::int64_t id, EncodedMessage& message, int index) {
  const std::size_t offset = static_cast<std::size_t>(index) * kPieceBytes;
  chunk_t chunk{};
  chunk.session_id = any_session_ ? 0 : endpoint_.session_id();
  chunk.sender_id = endpoint_.sender_id();
  chunk.message_id = id;
  chunk.index = index;
  chunk.count = message.pieces;
  chunk.total_size = static_cast<std::int32_t>(message.bytes.size());
  chunk.offset = static_cast<std::int32_t>(offset);
  chunk.crc32 = static_cast<std::int32_t>(message.crc);
  chunk.size = static_cast<std::int32_t>(std::min(kPieceBytes, message.bytes.size() - offset));
  sent_end_ = std::max(sent_end_, id + 1);
  ++endpoint_.counters()["chunks_sent"];
  if (message.sent[static_cast<std::size_t>(index)]) ++endpoint_.counters()["chunks_resent"];
  message.sent[static_cast<std::size_t>(index)] = true;
  // The bytes before the piece lend their place to its head: a piece is not copied to be sent.
  const ByteVector head = encode_chunk_head(chunk);
  const auto size = static_cast<std::size_t>(chunk.size);
  if (offset < head.size()) {
    ByteVector bytes(head);
    bytes.insert(bytes.end(), message.bytes.begin(), message.bytes.begin() + chunk.size);
    return endpoint_.bus().publish(chunk_channel(topic_), bytes.data(), bytes.size());
  }
  std::uint8_t* begin = message.bytes.data() + offset - head.size();
  const ByteVector lent(begin, begin + head.size());
  std::copy(head.begin(), head.end(), begin);
  endpoint_.bus().publish(chunk_channel(topic_), begin, head.size() + size);
  std::copy(lent.begin(), lent.end(), begin);
}

void Outbox::poll() {
  if (!offered_) return;
  const std::int64_t now = endpoint_.bus().now_us();
  if (now - last_offer_us_ >= kOfferPeriodUs) publish_offer();
  answer_waiting();
  for (int n = 0; n < kUnaskedPiecesATick && !everything_.empty(); ++n) {
    const auto [id, index] = everything_.front();
    const auto message = id >= offer_.first_id && id < offer_.next_id ? provider_(id) : nullptr;
    if (!message) {
      everything_.clear();
      break;
    }
    everything_.pop_front();
    send_piece(id, *message, index);
  }
}

}  // namespace hp2
