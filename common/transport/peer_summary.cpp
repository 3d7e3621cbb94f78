#include "common/transport/peer_summary.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace hp2 {

nlohmann::ordered_json peers_as_json(const Presence& presence) {
  static constexpr std::array<const char*, 5> kStates{"waiting", "running", "paused", "finished", "failed"};
  std::vector<Peer> heard{Peer{presence.status(), presence.now_us()}};
  for (const auto& entry : presence.peers()) {
    if (entry.second.status.session_id == presence.status().session_id) heard.push_back(entry.second);
  }
  std::sort(heard.begin(), heard.end(), [](const Peer& a, const Peer& b) { return a.heard_us < b.heard_us; });
  auto all = nlohmann::ordered_json::object();
  for (const auto& peer : heard) {
    const status_t& s = peer.status;
    auto& j = all[s.process];
    j["restarts"] = j.contains("restarts") ? j["restarts"].get<int>() + 1 : 0;
    j["version"] = s.version;
    j["host"] = s.host;
    j["pid"] = s.pid;
    j["state"] = s.state >= 0 && s.state < 5 ? kStates[static_cast<std::size_t>(s.state)] : "unknown";
    j["text"] = s.text;
    j["total"] = s.total;
    j["peak_memory_mb"] =
        std::max(s.peak_memory_mb, j.contains("peak_memory_mb") ? j["peak_memory_mb"].get<double>() : 0.0);
    auto& counters = j["counters"];
    for (const auto& c : s.counters) {
      if (c.name == "busy") continue;  // of that moment alone
      counters[c.name] = c.value + (counters.contains(c.name) ? counters[c.name].get<std::int64_t>() : 0);
    }
  }
  return all;
}

nlohmann::ordered_json warnings_as_json(const Presence& presence) { return presence.warnings(); }

std::string as_text(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

}  // namespace hp2
