#include "common/transport/endpoint.hpp"

#include <algorithm>
#include <random>

#include <spdlog/spdlog.h>

#include "common/text.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/inbox.hpp"
#include "common/transport/outbox.hpp"

namespace hp2 {
namespace {

constexpr int kOfferQueue = 200;
constexpr int kFetchQueue = 500;
constexpr std::int64_t kSecond = 1'000'000;
constexpr std::size_t kMostForeign = 256;
constexpr std::int64_t kSilentSessionUs = 5 * kSecond;

}  // namespace

std::int64_t random_id() {
  std::random_device device;
  const std::uint64_t bits = std::uint64_t{device()} << 32U | device();
  return static_cast<std::int64_t>(bits >> 2U) | 1;
}

Endpoint::Endpoint(Bus& bus) : bus_(bus), sender_id_(random_id()) {
  // A third of a large buffer, as several readers of a topic hear each other's pieces. Of a small one a
  // datagram's room is left for everything that this process did not ask for. More at once would overrun the
  // queue of 30 messages that LCM gives a subscriber such as lcm-logger.
  constexpr int kSmall = 8, kMost = 20;
  const int capacity = bus.receive_capacity();
  max_window_ = window_ = std::clamp(capacity / 3, std::clamp(capacity - 1, 1, kSmall), kMost);
  for (const char* name : {"chunks_sent", "chunks_resent", "duplicates", "lost", "rejected"})
    counters_[name] = 0;
  bus_.subscribe(
      kOfferChannel, [this](const auto* data, auto size) { on_offer(data, size); }, kOfferQueue);
  bus_.subscribe(
      kFetchChannel, [this](const auto* data, auto size) { on_fetch(data, size); }, kFetchQueue);
  // fetch_t::target_id comes after the fingerprint and two other numbers.
  constexpr std::size_t kTargetOffset = 24;
  bus_.set_address(kFetchChannel, static_cast<std::uint64_t>(fetch_t::getHash()), kTargetOffset, sender_id_);
}

void Endpoint::set_session(std::int64_t session_id) { session_id_ = session_id; }

void Endpoint::reject(const std::string& channel, const std::string& why) {
  ++counters_["rejected"];
  if (last_reject_log_us_ == 0 || bus_.now_us() - last_reject_log_us_ > kSecond) {
    last_reject_log_us_ = bus_.now_us();
    spdlog::warn("rejected a message on {}: {} ({} so far)", channel, why, counters_["rejected"]);
  }
}

void Endpoint::on_offer(const std::uint8_t* data, std::size_t size) {
  offer_t offer;
  if (!safe_decode(data, size, offer)) return reject(kOfferChannel, "not a valid offer_t");
  if (offer.session_id <= 0 || offer.sender_id == 0 || offer.first_id < 0 || offer.next_id < offer.first_id) {
    return reject(kOfferChannel,
                  "impossible numbers in an offer of topic " + printable(offer.topic.substr(0, 40)));
  }
  if (offer.sender_id == sender_id_) return;
  if (session_id_ == 0 && adopt_from_.count(offer.topic) != 0) {
    spdlog::info("session {}", offer.session_id);
    set_session(offer.session_id);
  }
  if (session_id_ == 0) return;
  const std::int64_t now = bus_.now_us();
  if (offer.session_id == session_id_) own_session_heard_us_ = now;
  const bool silent = now - own_session_heard_us_ > kSilentSessionUs;
  if (offer.session_id != session_id_ && silent && adopt_from_.count(offer.topic) != 0 && nothing_begun_ &&
      nothing_begun_()) {
    spdlog::warn("session {} has gone: taking up session {}", session_id_, offer.session_id);
    set_session(offer.session_id);
    own_session_heard_us_ = now;
  }
  if (offer.session_id != session_id_) {
    if (foreign_senders_.size() >= kMostForeign) foreign_senders_.clear();
    foreign_senders_.insert(offer.sender_id);
    if (bus_.now_us() - last_other_session_log_us_ > 10 * kSecond) {
      last_other_session_log_us_ = bus_.now_us();
      spdlog::warn("ignoring offers of another session ({}); this is session {}", offer.session_id,
                   session_id_);
    }
    return;
  }
  for (auto* inbox : inboxes_) {
    if (inbox->topic() == offer.topic) inbox->on_offer(offer);
  }
  const auto watcher = watchers_.find(offer.topic);
  if (watcher != watchers_.end()) watcher->second(offer);
}

void Endpoint::on_fetch(const std::uint8_t* data, std::size_t size) {
  fetch_t fetch;
  if (!safe_decode(data, size, fetch)) return reject(kFetchChannel, "not a valid fetch_t");
  if (fetch.target_id != sender_id_ || fetch.session_id != session_id_) return;
  if (fetch.sender_id == 0 || fetch.done_id < 0 || fetch.wanted_id < 0 || fetch.message_id < 0) {
    return reject(kFetchChannel, "impossible numbers");
  }
  for (auto* outbox : outboxes_) {
    if (outbox->topic() == fetch.topic) outbox->on_fetch(fetch);
  }
}

void Endpoint::poll() {
  for (auto* outbox : outboxes_) outbox->poll();
  for (auto* inbox : inboxes_) inbox->poll();
}

void Endpoint::window_loss() {
  successes_ = 0;
  // Several pieces of one burst that are lost together are one event.
  if (last_loss_us_ != 0 && bus_.now_us() - last_loss_us_ < 20'000) return;
  last_loss_us_ = bus_.now_us();
  window_ = std::max(1, window_ / 2);
}

void Endpoint::window_success() {
  if (++successes_ >= 32 && window_ < max_window_) {
    ++window_;
    successes_ = 0;
  }
}

}  // namespace hp2
