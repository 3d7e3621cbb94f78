#include "common/session/session_check.hpp"

#include <filesystem>

#include "common/error.hpp"
#include "common/session/session_lock.hpp"
#include "common/session/session_store.hpp"

namespace hp2 {
namespace {

std::string counted(std::size_t scans, std::int64_t submaps) {
  return std::to_string(scans) + (scans == 1 ? " scan in " : " scans in ") + std::to_string(submaps) +
         (submaps == 1 ? " submap" : " submaps");
}

}  // namespace

std::string check_session(const std::string& folder, const std::map<std::string, std::string>& meta) {
  namespace fs = std::filesystem;
  std::error_code ec;
  if (!fs::exists(fs::path(folder) / "session.sqlite", ec)) return "a new session in " + folder;
  { const SessionLock nobody_else(folder); }
  const SessionStore store(folder, SessionStore::Access::kReadOnly);
  const auto stored = store.read_meta();
  const auto text = [&stored](const std::string& key) {
    const auto it = stored.find(key);
    return it == stored.end() ? std::string() : it->second;
  };
  const GraphState graph = store.read_graph();
  const std::string holds = counted(graph.trajectory.size(), store.submap_count());
  if (store.last_submap_stored() || graph.ended) {
    const std::string drive = text("drive");
    throw Error("the session is complete: " + holds + (drive.empty() ? "" : " of " + drive), folder,
                "A complete session is not added to: choose another folder.");
  }
  // A run that failed before its first submap ties nobody to its drive.
  if (store.submap_count() == 0) return "a new session in " + folder;
  for (const char* key : {"drive", "configuration"}) {
    const auto wanted = meta.find(key);
    if (wanted == meta.end() || text(key).empty() || text(key) == wanted->second) continue;
    const bool drive = key == std::string("drive");
    throw Error(drive ? "the session was begun with another drive: " + text(key) + ", not " + wanted->second
                      : "the session was begun with other settings",
                folder, "Go on with the same drive and settings, or choose another folder.");
  }
  return "going on with the session in " + folder + ": " + holds + " are stored";
}

}  // namespace hp2
