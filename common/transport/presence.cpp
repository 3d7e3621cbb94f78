#include "common/transport/presence.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <tuple>
#include <unistd.h>

#include <spdlog/spdlog.h>

#include "common/program.hpp"
#include "common/text.hpp"
#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kPeriodUs = 500'000;
constexpr std::int64_t kRateWindowUs = 3'000'000;
constexpr std::int64_t kLiveUs = 1'500'000;
constexpr std::int64_t kMissedUs = 30'000'000;
constexpr std::size_t kMostPeers = 64;
constexpr std::size_t kMostCounters = 100;
constexpr std::size_t kLongestText = 300;
constexpr std::size_t kMostWarnings = 20;
const std::string kWarningMark = "warning: ";
constexpr int kStatusQueue = 64;

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "";
}

}  // namespace

Presence::Presence(Endpoint& endpoint, std::string process)
    : endpoint_(endpoint), process_(std::move(process)), host_(host_name()) {
  endpoint_.bus().subscribe(
      kStatusChannel, [this](const auto* data, auto size) { on_status(data, size); }, kStatusQueue);
}

void Presence::set(const Report& report) {
  const bool news = report.state != report_.state || report.text != report_.text;
  report_ = report;
  if (report_.text.size() > kLongestText) report_.text.resize(kLongestText);
  if (news) spdlog::info("{}", report_.text);
  const bool last = report_.state == status_t::FINISHED || report_.state == status_t::FAILED;
  // In a short run some remarks were not sent yet: each is sent once more, then the final status.
  if (news && last) {
    for (std::size_t i = 0; i < 2 * warnings_.size(); ++i) poll(true);
  }
  poll(news);
}

void Presence::warn(const std::string& text) {
  spdlog::warn("{}", text);
  if (warnings_.size() >= kMostWarnings) return;
  warnings_.push_back(text.substr(0, kLongestText - 20));
  all_warnings_.push_back(process_ + ": " + warnings_.back());
}

double Presence::rate() const {
  if (history_.size() < 2) return 0.0;
  const auto& [t0, done0] = history_.front();
  const auto& [t1, done1] = history_.back();
  return t1 > t0 ? 1e6 * static_cast<double>(done1 - done0) / static_cast<double>(t1 - t0) : 0.0;
}

status_t Presence::status() const {
  status_t m;
  m.utime = endpoint_.bus().wall_us();
  m.session_id = endpoint_.session_id();
  m.sender_id = endpoint_.sender_id();
  m.number = number_;
  m.process = process_;
  m.version = version();
  m.pid = ::getpid();
  m.host = host_;
  m.state = report_.state;
  m.text = report_.text;
  m.done = report_.done;
  m.total = report_.total;
  m.rate = rate();
  m.peak_memory_mb = peak_memory_mb();
  for (const auto& [name, value] : endpoint_.counters()) {
    counter_t counter;
    counter.name = name;
    counter.value = value;
    m.counters.push_back(std::move(counter));
  }
  m.n_counters = static_cast<std::int32_t>(m.counters.size());
  return m;
}

void Presence::poll(bool force) {
  const std::int64_t now = endpoint_.bus().now_us();
  // A new remark is sent at once: in a short run its turn would come after the viewer has written.
  const bool remark = told_ < warnings_.size() && endpoint_.session_id() != 0;
  if (!force && !remark && now - last_us_ < kPeriodUs) return;
  last_us_ = now;
  const Bus& bus = endpoint_.bus();
  endpoint_.counters()[bus.passes_over() ? "datagrams_passed_over" : "datagrams_dropped"] = bus.dropped();
  if (!history_.empty() && report_.done < history_.back().second) history_.clear();
  history_.emplace_back(now, report_.done);
  while (now - history_.front().first > kRateWindowUs) history_.pop_front();
  status_t m = status();
  const auto turn = static_cast<std::size_t>(m.number) % (2 * std::max<std::size_t>(1, warnings_.size()));
  if (remark) {
    m.text = kWarningMark + warnings_[told_++];
  } else if (turn % 2 == 1 && !warnings_.empty()) {
    m.text = kWarningMark + warnings_[turn / 2];
  }
  ++number_;
  endpoint_.publish(kStatusChannel, m);
}

void Presence::on_status(const std::uint8_t* data, std::size_t size) {
  status_t m;
  if (!safe_decode(data, size, m)) return endpoint_.reject(kStatusChannel, "not a valid status_t");
  if (m.counters.size() > kMostCounters || m.text.size() > kLongestText || m.process.size() > kLongestText ||
      m.host.size() > kLongestText || m.version.size() > kLongestText || m.sender_id == 0) {
    return endpoint_.reject(kStatusChannel, "longer than any process writes");
  }
  if (m.sender_id == endpoint_.sender_id()) return;
  // Control characters would reach the terminal of a user who lists the processes.
  for (auto* text : {&m.process, &m.text, &m.host, &m.version}) *text = printable(*text);
  for (auto& counter : m.counters) counter.name = printable(counter.name);
  if (peers_.size() >= kMostPeers && peers_.count(m.sender_id) == 0) {
    // A flood on the channel must not displace this session's processes.
    const auto worth = [this](const Peer& p) {
      return std::make_tuple(p.status.session_id == endpoint_.session_id(), std::min(p.times, 3), p.heard_us);
    };
    peers_.erase(std::min_element(peers_.begin(), peers_.end(), [&](const auto& a, const auto& b) {
      return worth(a.second) < worth(b.second);
    }));
  }
  if (m.text.rfind(kWarningMark, 0) == 0 && m.session_id == endpoint_.session_id()) {
    const std::string warning = m.process + ": " + m.text.substr(kWarningMark.size());
    const bool known = std::find(all_warnings_.begin(), all_warnings_.end(), warning) != all_warnings_.end();
    if (!known && all_warnings_.size() < 4 * kMostWarnings) all_warnings_.push_back(warning);
  }
  const std::int64_t sender = m.sender_id;
  Peer& peer = peers_[sender];
  const std::int64_t now = endpoint_.bus().now_us();
  const bool spoke = peer.times > 0 && now - peer.heard_us <= kLiveUs;  // as a process does, twice a second
  peer = Peer{std::move(m), now, peer.times + 1, spoke ? peer.first_us : now};
}

std::vector<const Peer*> Presence::all_live(const std::string& name) const {
  const std::int64_t now = endpoint_.bus().now_us();
  std::vector<const Peer*> all;
  for (const auto& [id, peer] : peers_) {
    const bool ended = peer.status.state == status_t::FINISHED || peer.status.state == status_t::FAILED;
    if (peer.status.process == name && peer.status.session_id == endpoint_.session_id() && !ended &&
        now - peer.heard_us < kLiveUs) {
      all.push_back(&peer);
    }
  }
  return all;
}

bool Presence::missed(const Peer& peer) const {
  if (peer.status.state == status_t::FINISHED || peer.status.state == status_t::FAILED) return false;
  const std::int64_t silent_us = endpoint_.bus().now_us() - peer.heard_us;
  if (silent_us < kLiveUs) return true;
  const bool dead = peer.status.host == host_ && peer.status.pid > 0 && !exists(peer);
  return !dead && silent_us < kMissedUs;
}

bool Presence::missed(std::int64_t sender_id) const {
  const auto peer = peers_.find(sender_id);
  return peer == peers_.end() || missed(peer->second);
}

bool Presence::exists(const Peer& peer) const {
  if (peer.status.pid <= 0) return false;
  if (::kill(static_cast<pid_t>(peer.status.pid), 0) != 0) return errno != ESRCH;
  // One that was killed and that its parent has not asked for yet.
  std::ifstream stat("/proc/" + std::to_string(peer.status.pid) + "/stat");
  std::string line;
  std::getline(stat, line);
  const auto name_end = line.rfind(')');
  return name_end == std::string::npos || line.find_first_of("ZX", name_end) != name_end + 2;
}

bool Presence::may_return(std::int64_t sender_id) const {
  const auto at = peers_.find(sender_id);
  if (at == peers_.end()) return true;
  const Peer& peer = at->second;
  const bool ended = peer.status.state == status_t::FINISHED || peer.status.state == status_t::FAILED;
  if (ended) return false;
  return peer.status.host == host_ ? exists(peer) : missed(peer);
}

std::vector<const Peer*> Presence::all_missed(const std::string& name) const {
  std::vector<const Peer*> all;
  for (const auto& [id, peer] : peers_) {
    if (peer.status.process == name && peer.status.session_id == endpoint_.session_id() && missed(peer)) {
      all.push_back(&peer);
    }
  }
  return all;
}

const Peer* Presence::live(const std::string& name) const {
  const auto all = all_live(name);
  return all.empty() ? nullptr : all.front();
}

}  // namespace hp2
