#include "frontend/process/live_scans.hpp"

#include <utility>

#include <spdlog/spdlog.h>

#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kSilenceUs = 2'000'000;
constexpr int kScanQueue = 16;

}  // namespace

LiveScans::LiveScans(Endpoint& endpoint, int backlog)
    : endpoint_(endpoint), backlog_(static_cast<std::size_t>(backlog)) {
  endpoint_.bus().subscribe(
      kScanChannel, [this](const auto* data, auto size) { take(data, size); }, kScanQueue);
}

bool LiveScans::active() const { return last_us_ != 0 && endpoint_.bus().now_us() - last_us_ < kSilenceUs; }

void LiveScans::take(const std::uint8_t* data, std::size_t size) {
  const std::int64_t now = endpoint_.bus().now_us();
  if (!allowed_) {
    ++endpoint_.counters()["live_scans_refused"];
    if (last_refused_us_ == 0 || now - last_refused_us_ > kSilenceUs) {
      spdlog::warn("live scans are refused while a player offers scans, or before the session has begun");
      last_refused_us_ = now;
    }
    return;
  }
  auto scan = decode_scan(data, size);
  if (!scan) return endpoint_.reject(kScanChannel, "not a valid scan_t");
  if (!active()) {
    spdlog::info("live scans begin at scan {}", next_);
    offset_ = scan->sequence >= next_ || scan->sequence < 0 ? 0 : next_ - scan->sequence;
  }
  last_us_ = now;
  if (scan->sequence < 0) {
    scan->sequence = next_;
  } else {
    if (scan->sequence + offset_ < next_) {
      // A replayed duplicate, or a driver that was started anew and counts from 0 again.
      if (scan->sequence != 0) {
        ++endpoint_.counters()["duplicates"];
        return;
      }
      offset_ = next_;
    }
    scan->sequence += offset_;
  }
  next_ = scan->sequence + 1;
  queue_.push_back(std::move(*scan));
  if (queue_.size() > backlog_) {
    queue_.pop_front();
    ++endpoint_.counters()["live_scans_dropped"];
  }
}

std::optional<Scan> LiveScans::pop() {
  if (queue_.empty()) return std::nullopt;
  Scan scan = std::move(queue_.front());
  queue_.pop_front();
  return scan;
}

}  // namespace hp2
