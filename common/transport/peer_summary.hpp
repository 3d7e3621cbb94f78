// The status of the processes, as JSON for summaries.
#pragma once
#include <nlohmann/json.hpp>

#include "common/transport/presence.hpp"

namespace hp2 {

/// One object a process name, from the last STATUS of each process of this session, this one included:
/// "version", "host", "pid", "peak_memory_mb", "state", "text", "counters". Of a process that was restarted,
/// "restarts" says how often; counters are added up and the largest peak memory is taken.
nlohmann::ordered_json peers_as_json(const Presence& presence);
/// All remarks on the data, as an array of strings.
nlohmann::ordered_json warnings_as_json(const Presence& presence);

/// On one line. What is no UTF-8 (others may send anything) is replaced.
std::string as_text(const nlohmann::ordered_json& json);

}  // namespace hp2
