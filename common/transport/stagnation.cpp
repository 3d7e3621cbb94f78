#include "common/transport/stagnation.hpp"

#include <algorithm>

#include <spdlog/spdlog.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kSecond = 1'000'000;
constexpr std::int64_t kLineEveryUs = 30 * kSecond;
constexpr std::int64_t kSilentUs = 5 * kSecond;
const char* const kBusyCounter = "busy";

bool is_busy(const status_t& status) {
  return std::any_of(status.counters.begin(), status.counters.end(),
                     [](const counter_t& c) { return c.name == kBusyCounter && c.value != 0; });
}

}  // namespace

Stagnation::Stagnation(Endpoint& endpoint, const Presence& presence, double give_up_after_s)
    : endpoint_(endpoint),
      presence_(presence),
      give_up_after_us_(static_cast<std::int64_t>(give_up_after_s * 1e6)),
      last_us_(endpoint.bus().now_us()) {
  endpoint_.counters()[kBusyCounter] = 0;
}

std::uint64_t Stagnation::signature(bool& others_work) const {
  const std::int64_t now = endpoint_.bus().now_us();
  auto sum = static_cast<std::uint64_t>(presence_.report().done);
  for (const auto& [id, peer] : presence_.peers()) {
    if (!peer.established() || peer.status.session_id != endpoint_.session_id()) continue;
    const bool silent = now - peer.heard_us > kSilentUs;
    others_work = others_work || (!silent && (is_busy(peer.status) || peer.status.state == status_t::PAUSED));
    sum = sum * 31 + static_cast<std::uint64_t>(peer.status.done ^ id) + (silent ? 1 : 0);
  }
  return sum;
}

void Stagnation::tick(bool busy, bool idle) {
  endpoint_.counters()[kBusyCounter] = busy ? 1 : 0;
  // A machine that was suspended, or a process that was stopped, has not waited.
  const std::int64_t now = endpoint_.bus().now_us();
  nothing_us_ += std::min(now - last_us_, kSecond);
  last_us_ = now;
  bool others_work = false;
  const std::uint64_t current = signature(others_work);
  if (busy || idle || others_work || current != signature_) {
    signature_ = current;
    nothing_us_ = said_us_ = 0;
    return;
  }
  if (give_up_after_us_ > 0 && nothing_us_ >= give_up_after_us_) {
    throw Error(
        line(), "given up",
        "Start what is missing, then the same command again: what is stored is kept. --give-up-after 0 waits "
        "for ever.");
  }
  if (nothing_us_ - said_us_ < kLineEveryUs) return;
  said_us_ = nothing_us_;
  spdlog::warn("{}", line());
}

std::string Stagnation::line() const {
  std::string text = "nothing has happened for " + std::to_string(nothing_us_ / kSecond) + " s (" +
                     presence_.report().text + ")";
  std::string heard;
  for (const auto& [id, peer] : presence_.peers()) {
    if (peer.status.session_id != endpoint_.session_id() || peer.status.state == status_t::FINISHED) continue;
    const std::int64_t silent_s = (endpoint_.bus().now_us() - peer.heard_us) / kSecond;
    heard += (heard.empty() ? "" : ", ") + peer.status.process + " " + std::to_string(peer.status.pid) +
             (silent_s * kSecond > kSilentUs ? " silent for " + std::to_string(silent_s) + " s"
                                             : " \"" + peer.status.text + "\"");
  }
  return text + (heard.empty() ? "; nobody else is heard in this session" : "; others: " + heard);
}

}  // namespace hp2
