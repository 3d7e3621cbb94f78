#include "frontend/process/kept_submaps.hpp"

#include <utility>

#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMostBytes = std::size_t{400} << 20U;

}  // namespace

KeptSubmaps::KeptSubmaps(Endpoint& endpoint, bool keep)
    : keep_(keep), outbox_(endpoint, kSubmapTopic, [this](std::int64_t id) {
        for (const auto& kept : kept_) {
          if (kept.id == id) return kept.message;
        }
        return EncodedMessagePtr();
      }) {}

void KeptSubmaps::begin(std::int64_t next_submap, std::int64_t next_sequence, bool ended) {
  kept_.clear();
  bytes_ = 0;
  next_submap_ = next_submap;
  stored_sequence_ = next_sequence;
  ended_ = ended;
  outbox_.forget_readers();  // one may have confirmed more than it turned out to have
  offer();
}

void KeptSubmaps::add(std::vector<SubmapOut> submaps, bool ended) {
  for (auto& submap : submaps) {
    next_submap_ = submap.id + 1;
    if (keep_) {
      bytes_ += submap.message->bytes.size();
      kept_.push_back(std::move(submap));
    } else {
      stored_sequence_ = submap.next_sequence;
    }
  }
  ended_ = ended_ || ended;
  offer();
}

bool KeptSubmaps::drop_stored() {
  bool dropped = false;
  while (!kept_.empty() && kept_.front().id < outbox_.done_id()) {
    stored_sequence_ = kept_.front().next_sequence;
    bytes_ -= kept_.front().message->bytes.size();
    kept_.pop_front();
    dropped = true;
  }
  if (dropped) offer();
  return dropped;
}

bool KeptSubmaps::full() const { return bytes_ >= kMostBytes; }

void KeptSubmaps::offer() { outbox_.offer(first(), next_submap_, ended_); }

}  // namespace hp2
