#include "frontend/process/live_scans.hpp"

#include <algorithm>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/text.hpp"
#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

constexpr int kScanQueue = 16;
constexpr std::size_t kLongestName = 60;

}  // namespace

LiveScans::LiveScans(Endpoint& endpoint, int backlog, Warn warn)
    : endpoint_(endpoint), backlog_(static_cast<std::size_t>(backlog)), warn_(std::move(warn)) {
  endpoint_.bus().subscribe(
      kScanChannel, [this](const auto* data, auto size) { take(data, size, 0); }, kScanQueue);
}

bool LiveScans::active() const { return streams_.active(endpoint_.bus().now_us()); }

void LiveScans::take(const std::uint8_t* data, std::size_t size, std::int64_t sender) {
  const std::int64_t now = endpoint_.bus().now_us();
  if (!refused_because_.empty()) {
    ++endpoint_.counters()["live_scans_refused"];
    if (told_refusal_ != refused_because_) {
      told_refusal_ = refused_because_;
      warn_("live scans are refused and counted (live_scans_refused): " + refused_because_);
    }
    return;
  }
  auto scan = decode_scan(data, size);
  if (!scan) {
    const std::string fault = scan_fault(data, size);
    for (const auto& text : checks_.refused(fault)) warn_(text);
    return endpoint_.reject(kScanChannel, fault);
  }
  scan->sensor = printable(scan->sensor.substr(0, kLongestName));
  for (const auto& text : checks_.look_at(*scan, now)) warn_(text);
  if (sender == 0) check_size(size);
  if (!active()) spdlog::info("live scans begin at scan {}", streams_.next());
  queue(streams_.take(std::move(*scan), sender, now));
}

// A whole scan that fills the receive buffer is lost as soon as this process is busy for a moment.
void LiveScans::check_size(std::size_t size) {
  const auto capacity = static_cast<std::size_t>(endpoint_.bus().receive_capacity()) * kPieceBytes;
  if (told_size_ || 2 * size < capacity) return;
  told_size_ = true;
  warn_("live scans of " + std::to_string(size) +
        " bytes come whole, and the receive buffer of this process holds about " + std::to_string(capacity) +
        ": under load they are lost without a trace. Send them in pieces (chunk_t on HP2_CHUNK_SCAN), or "
        "raise the buffer "
        "as root: sysctl -w net.core.rmem_max=" +
        std::to_string(std::max<std::size_t>(std::size_t{8} << 20U, 8 * size)) +
        "; hp2_control check measures it");
}

void LiveScans::poll() { queue(streams_.poll(endpoint_.bus().now_us())); }

void LiveScans::queue(std::vector<Scan> scans) {
  for (const auto& [name, count] : streams_.take_counts()) endpoint_.counters()[name] += count;
  for (const auto& text : streams_.take_remarks()) warn_(text);
  if (scans.size() > 1) held_ += scans.size() - 1;
  for (Scan& scan : scans) queue_.push_back(std::move(scan));
  while (queue_.size() > backlog_ + held_) {
    queue_.pop_front();
    ++endpoint_.counters()["live_scans_dropped"];
  }
}

std::optional<Scan> LiveScans::pop() {
  if (queue_.empty()) return std::nullopt;
  Scan scan = std::move(queue_.front());
  queue_.pop_front();
  held_ = std::min(held_, queue_.size());
  return scan;
}

}  // namespace hp2
