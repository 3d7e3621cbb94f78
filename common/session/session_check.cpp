#include "common/session/session_check.hpp"

#include <filesystem>

#include "common/error.hpp"
#include "common/session/session_file.hpp"
#include "common/session/session_lock.hpp"
#include "common/session/session_store.hpp"

namespace hp2 {
namespace {

std::string counted(std::size_t scans, std::int64_t submaps) {
  return std::to_string(scans) + (scans == 1 ? " scan in " : " scans in ") + std::to_string(submaps) +
         (submaps == 1 ? " submap" : " submaps");
}

}  // namespace

std::int64_t stored_session_id(const std::string& folder) {
  if (!session_begun(folder)) return 0;
  return SessionStore(folder, SessionStore::Access::kReadOnly).session_id();
}

std::string check_session(const std::string& folder, const std::map<std::string, std::string>& meta) {
  std::error_code ec;
  if (!std::filesystem::exists(session_path(folder), ec)) return "a new session in " + folder;
  const SessionLock nobody_else(folder);
  if (!session_begun(folder)) return "a new session in " + folder;
  const SessionStore store(folder, SessionStore::Access::kReadOnly);
  const auto stored = store.read_meta();
  const auto text = [&stored](const std::string& key) {
    const auto it = stored.find(key);
    return it == stored.end() ? std::string() : it->second;
  };
  const GraphState graph = store.read_graph();
  const std::string holds = counted(graph.trajectory.size(), store.submap_count());
  if (store.results_written()) {
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
  if (!store.last_submap_stored()) store.read_frontend_state();  // damaged, nothing can go on from it
  const std::string what = graph.ended                  ? ", their results are not written yet"
                           : store.last_submap_stored() ? ", all of the drive, which is not refined yet"
                                                        : "";
  return "going on with the session in " + folder + ": " + holds + " are stored" + what;
}

}  // namespace hp2
