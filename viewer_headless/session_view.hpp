// The viewer's input: a session as it stands, live or read from disk.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// A session at one revision of its graph. Submaps come one by one through a callback, so that their points
/// are never all in memory at once.
struct SessionView {
  std::int64_t session_id = 0;
  /// Keyposes, closures and the trajectory. Scans of a submap that `trajectory` does not have yet are placed
  /// by the submap's keypose, submaps beyond `map_from_submap` by `map_from_odom`.
  GraphState graph;
  std::int64_t submap_count = 0;  ///< Submaps that can be read: ids 0 .. n-1.
  /// Reads one submap with its points; may throw Error. Called once per submap and write_session call, in
  /// order of id.
  std::function<Submap(std::int64_t)> read_submap;

  /// Ground truth, if there is any: entry i is world_from_sensor of the scan with sequence number i, at the
  /// end of its sweep. Poses that are not finite stand for "not known here".
  std::vector<Pose> ground_truth;

  /// What ran, for people, as SessionStore::read_meta gives it. Known keys are shown under their own names:
  /// "data", "format", "sensor", "configuration" (YAML text), "version", "command", "host", "started" (date).
  /// Others are listed as they are.
  std::map<std::string, std::string> meta;
  /// One object a process, by name ("hp2_player", ...), from its last STATUS. Known members: "version"
  /// (string), "host" (string), "pid", "peak_memory_mb" (number), "state" (string), "text" (string),
  /// "counters" (object of integers). Anything may be missing.
  nlohmann::ordered_json processes = nlohmann::ordered_json::object();
  /// Of the program that writes the files [MB]; 0: not known.
  double viewer_peak_memory_mb = 0.0;
  /// Remarks of the processes on the data, e.g. "the scans carry no time in the sweep: no deskew".
  std::vector<std::string> warnings;

  std::int64_t scans_in =
      -1;  ///< Scans that the player has sent; -1: not known (the last sequence number + 1 is taken).
  double elapsed_s = -1.0;  ///< Wall-clock time from the first to the last scan registered; -1: not known.
};

}  // namespace hp2
