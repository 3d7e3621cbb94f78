#include "common/transport/inbox.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

constexpr int kChunkQueue = 400;
constexpr std::int64_t kOwnerDeadUs = 1'500'000;
constexpr std::int64_t kFirstTimeoutUs = 30'000;
constexpr int kMostDoublings = 4;
constexpr std::int64_t kAcknowledgePeriodUs = 10'000;
constexpr std::int64_t kRepeatAcknowledgeUs = 100'000;
constexpr std::int64_t kSettledUs = 200'000;  // an offer is repeated 4 times a second
constexpr int kOvertakenMeansLost = 3;        // pieces asked for later that came first
constexpr std::size_t kMostUnasked = 6;
constexpr std::int64_t kUnaskedPatienceUs = 100'000, kUnaskedTimeoutUs = 2'000'000;
constexpr std::int32_t kMostPieces = 1 << 16;

}  // namespace

Inbox::Inbox(Endpoint& endpoint, Options options, std::function<void(Delivery)> deliver)
    : endpoint_(endpoint), options_(std::move(options)), deliver_(std::move(deliver)) {
  endpoint_.inboxes_.push_back(this);
  endpoint_.bus().subscribe(
      chunk_channel(options_.topic), [this](const auto* data, auto size) { on_chunk(data, size); },
      kChunkQueue);
}

Inbox::~Inbox() {
  auto& all = endpoint_.inboxes_;
  all.erase(std::remove(all.begin(), all.end(), this), all.end());
}

void Inbox::seek(std::int64_t id) {
  next_ = id;
  for (auto it = assemblies_.begin(); it != assemblies_.end();) {
    const auto at = it++;
    if (at->first < id || at->first >= id + options_.prefetch) drop(at);
  }
  pump();
}

void Inbox::set_limit(std::int64_t id) {
  limit_ = id;
  pump();
}

void Inbox::acknowledge(std::int64_t wanted, std::int64_t done) {
  if (wanted == wanted_ && done == done_) return;
  wanted_ = wanted;
  done_ = done;
  acknowledge_now_ = true;
}

const offer_t* Inbox::offer() const {
  return offer_ && endpoint_.bus().now_us() - offer_heard_us_ < kOwnerDeadUs ? &*offer_ : nullptr;
}

bool Inbox::ended() const {
  return offer_ && offer_->ended != 0 && ended_since_us_ != 0 &&
         offer_heard_us_ - ended_since_us_ >= kSettledUs;
}

void Inbox::on_offer(const offer_t& heard) {
  const std::int64_t now = endpoint_.bus().now_us();
  const bool same_owner = offer_ && offer_->sender_id == heard.sender_id;
  if (!same_owner && offer() != nullptr) return;  // the first owner is alive: one at a time
  const bool changed = !same_owner || offer_->first_id != heard.first_id ||
                       offer_->next_id != heard.next_id || offer_->ended != heard.ended;
  if (!same_owner) {
    if (offer_) spdlog::info("{}: a new owner has taken over", options_.topic);
    for (auto& entry : assemblies_) forget_asked(entry.second);
  }
  if (heard.ended == 0) {
    ended_since_us_ = 0;
  } else if (ended_since_us_ == 0 || !same_owner || offer_->next_id != heard.next_id) {
    ended_since_us_ = now;
  }
  offer_ = heard;
  offer_heard_us_ = now;
  // An inbox that waits beyond the newest message was misled by another sender.
  const bool beyond = next_ > heard.next_id;
  if (options_.order == Order::kLatest && (heard.next_id - 1 > next_ || beyond || !same_owner)) {
    seek(std::max(heard.first_id, heard.next_id - 1));
  }
  if (changed && on_offer_changed_) on_offer_changed_(*offer_);
  if (now - last_fetch_us_ > kRepeatAcknowledgeUs) acknowledge_now_ = true;
  pump();
}

void Inbox::on_chunk(const std::uint8_t* data, std::size_t size) {
  const auto view = view_chunk(data, size);
  if (!view) return endpoint_.reject(chunk_channel(options_.topic), "not a valid chunk_t");
  const chunk_t& chunk = view->fields;
  if (chunk.session_id != 0 && chunk.session_id != endpoint_.session_id()) return;
  if (chunk.sender_id == endpoint_.sender_id()) return;
  if (chunk.count < 1 || chunk.count > kMostPieces || chunk.index < 0 || chunk.index >= chunk.count ||
      chunk.total_size < 8 || chunk.count > chunk.total_size || chunk.size < 1 || chunk.offset < 0 ||
      chunk.offset > chunk.total_size - chunk.size || chunk.message_id < 0 || chunk.sender_id == 0) {
    return endpoint_.reject(chunk_channel(options_.topic), "impossible numbers in a chunk");
  }
  if (static_cast<std::size_t>(chunk.total_size) > options_.max_message_bytes) {
    return endpoint_.reject(chunk_channel(options_.topic),
                            "message " + std::to_string(chunk.message_id) + " has " +
                                std::to_string(chunk.total_size) + " bytes; at most " +
                                std::to_string(options_.max_message_bytes) + " are taken");
  }
  if (!offer_ || chunk.sender_id != offer_->sender_id) {
    // A player's scans are for any session, but those of one that plays into another session are not for this
    // one.
    if (options_.accept_unasked && !endpoint_.is_foreign(chunk.sender_id)) take_unasked(*view);
    return;
  }
  const auto it = assemblies_.find(chunk.message_id);
  if (it == assemblies_.end()) {
    if (chunk.message_id < next_) ++endpoint_.counters()["duplicates"];
    return;
  }
  if (!take_piece(it->second, *view)) return;
  deliver_ready();
  pump();
}

bool Inbox::take_piece(Assembly& a, const ChunkView& view) {
  const chunk_t& chunk = view.fields;
  const bool same = a.same_edition(chunk);
  if (a.known && !same && a.sender_id == chunk.sender_id && a.whole()) return false;
  if (!same) {
    if (a.known) forget_asked(a);
    a.begin(chunk);
  }
  const Piece& piece = a.pieces[static_cast<std::size_t>(chunk.index)];
  if (piece.state == Piece::State::kHave) {
    ++endpoint_.counters()["duplicates"];
    return false;
  }
  const bool asked = piece.state == Piece::State::kAsked;
  if (asked) {
    endpoint_.piece_settled();
    endpoint_.window_success();
  }
  a.touched_us = endpoint_.bus().now_us();
  a.take(view);
  if (asked) {
    for (auto& entry : assemblies_) {
      if (!entry.second.known) continue;
      for (auto& other : entry.second.pieces) {
        if (other.state == Piece::State::kAsked &&
            other.ask_number + kOvertakenMeansLost <= piece.ask_number) {
          other.asked_us = 0;  // find_lost() takes it from here
        }
      }
    }
  }
  return true;
}

bool Inbox::intact(const Assembly& a) {
  if (a.intact()) return true;
  endpoint_.reject(chunk_channel(options_.topic),
                   "the checksum of message " + std::to_string(a.id) + " is wrong");
  return false;
}

std::size_t Inbox::unasked_bytes() const {
  std::size_t bytes = 0;
  for (const auto& entry : unasked_) bytes += entry.second.bytes ? entry.second.bytes->size() : 0;
  return bytes;
}

void Inbox::take_unasked(const ChunkView& view) {
  const chunk_t& chunk = view.fields;
  const auto key = std::make_pair(chunk.sender_id, chunk.message_id);
  auto it = unasked_.find(key);
  if (it == unasked_.end()) {
    // Incomplete messages must not fill the memory.
    std::size_t bytes = static_cast<std::size_t>(chunk.total_size) + unasked_bytes();
    while (!unasked_.empty() && (unasked_.size() >= kMostUnasked || bytes > 2 * options_.max_message_bytes)) {
      const auto oldest = std::min_element(
          unasked_.begin(), unasked_.end(),
          [](const auto& a, const auto& b) { return a.second.touched_us < b.second.touched_us; });
      bytes -= oldest->second.bytes ? oldest->second.bytes->size() : 0;
      unasked_.erase(oldest);
      ++endpoint_.counters()["lost"];
    }
    it = unasked_.emplace(key, Assembly{}).first;
    it->second.id = chunk.message_id;
    it->second.sender_id = chunk.sender_id;
  }
  if (take_piece(it->second, view)) release_unasked();
}

// Hands up whole messages, each sender's in order. An older one that is not whole is waited for a moment: the
// pieces of two messages may be interleaved.
void Inbox::release_unasked() {
  const std::int64_t now = endpoint_.bus().now_us();
  for (auto it = unasked_.begin(); it != unasked_.end();) {
    const auto next = std::next(it);
    Assembly& a = it->second;
    const bool newer_waits = next != unasked_.end() && next->first.first == a.sender_id;
    if (a.whole()) {
      Delivery delivery{a.id, a.bytes, a.sender_id};
      const bool good = intact(a);
      unasked_.erase(it);
      if (good && on_unasked_) on_unasked_(std::move(delivery));
    } else if (now - a.touched_us > (newer_waits ? kUnaskedPatienceUs : kUnaskedTimeoutUs)) {
      ++endpoint_.counters()["lost"];
      unasked_.erase(it);
    } else {
      const std::int64_t sender = a.sender_id;
      for (it = next; it != unasked_.end() && it->first.first == sender;) ++it;
      continue;
    }
    it = next;
  }
}

void Inbox::forget_asked(Assembly& a) {
  for (auto& piece : a.pieces) {
    if (piece.state != Piece::State::kAsked) continue;
    endpoint_.piece_settled();
    piece = Piece{};
  }
}

void Inbox::drop(std::map<std::int64_t, Assembly>::iterator at) {
  forget_asked(at->second);
  assemblies_.erase(at);
}

void Inbox::deliver_ready() {
  while (true) {
    const auto it = assemblies_.find(next_);
    if (it == assemblies_.end() || !it->second.whole()) return;
    if (!intact(it->second)) return drop(it);
    Delivery delivery{it->first, std::move(it->second.bytes), it->second.sender_id};
    drop(it);
    ++next_;
    deliver_(std::move(delivery));
  }
}

void Inbox::find_lost() {
  const std::int64_t now = endpoint_.bus().now_us();
  for (auto& [id, assembly] : assemblies_) {
    for (auto& piece : assembly.pieces) {
      if (piece.state != Piece::State::kAsked) continue;
      if (now - piece.asked_us < kFirstTimeoutUs << std::min<int>(piece.tries, kMostDoublings)) continue;
      piece.state = Piece::State::kMissing;
      if (piece.tries < 255) ++piece.tries;
      endpoint_.piece_settled();
      // The first piece of a message may be late because its owner is still reading it.
      if (assembly.known) {
        endpoint_.window_loss();
        ++endpoint_.counters()["chunks_reasked"];
      }
    }
  }
}

void Inbox::pump() {
  const offer_t* owner = offer();
  if (owner == nullptr || silent_) return;
  find_lost();
  if (!endpoint_.may_ask()) return;
  std::int64_t end = std::min({owner->next_id, limit_, next_ + options_.prefetch});
  if (options_.order == Order::kLatest) end = std::min(end, next_ + 1);
  for (std::int64_t id = next_; id < end && endpoint_.free_window() > 0; ++id) {
    if (id < owner->first_id) continue;
    auto& assembly = assemblies_[id];
    assembly.id = id;
    std::vector<std::int32_t> indices;
    for (std::size_t i = 0; i < assembly.pieces.size() && endpoint_.free_window() > 0; ++i) {
      Piece& piece = assembly.pieces[i];
      if (piece.state != Piece::State::kMissing) continue;
      piece.state = Piece::State::kAsked;
      piece.asked_us = endpoint_.bus().now_us();
      piece.ask_number = asks_++;
      endpoint_.piece_asked();
      indices.push_back(static_cast<std::int32_t>(i));
    }
    if (!indices.empty()) send_fetch(id, std::move(indices));
  }
}

void Inbox::send_fetch(std::int64_t message_id, std::vector<std::int32_t> indices) {
  fetch_t fetch;
  fetch.session_id = endpoint_.session_id();
  fetch.sender_id = endpoint_.sender_id();
  fetch.target_id = offer_->sender_id;
  fetch.topic = options_.topic;
  fetch.done_id = done_;
  fetch.wanted_id = wanted_;
  fetch.message_id = message_id;
  fetch.n = static_cast<std::int32_t>(indices.size());
  fetch.indices = std::move(indices);
  last_fetch_us_ = endpoint_.bus().now_us();
  acknowledge_now_ = false;
  endpoint_.publish(kFetchChannel, fetch);
}

void Inbox::poll() {
  if (!unasked_.empty()) release_unasked();
  if (offer() == nullptr || silent_) return;
  pump();
  if (acknowledge_now_ && endpoint_.bus().now_us() - last_fetch_us_ > kAcknowledgePeriodUs) send_fetch(0, {});
}

}  // namespace hp2
