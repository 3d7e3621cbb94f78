#include "viewer_headless/summary.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/program.hpp"

namespace hp2 {

using Json = nlohmann::ordered_json;

const std::array<const char*, 6> kStageNames{"preprocess", "neighbour_search", "planarity",
                                             "solve",      "map_update",       "total"};

namespace {

Json milliseconds(std::vector<double> values) {
  if (values.empty()) return {{"mean", nullptr}, {"median", nullptr}, {"p99", nullptr}, {"max", nullptr}};
  std::sort(values.begin(), values.end());
  double sum = 0;
  for (const double v : values) sum += v;
  // Nearest rank: the smallest value that 99 % of all do not exceed.
  const auto rank = static_cast<std::size_t>(std::ceil(0.99 * static_cast<double>(values.size())));
  const std::size_t n = values.size();
  return {{"mean", sum / static_cast<double>(n)},
          {"median", 0.5 * (values[(n - 1) / 2] + values[n / 2])},
          {"p99", values[std::max<std::size_t>(rank, 1) - 1]},
          {"max", values.back()}};
}

Json stages(const SessionDigest& digest) {
  Json out;
  for (std::size_t k = 0; k < kStageNames.size(); ++k) {
    std::vector<double> values;
    for (const ScanRecord& scan : digest.scans) {
      if (std::isfinite(scan.diagnostics.ms[k])) values.push_back(scan.diagnostics.ms[k]);
    }
    out[kStageNames[k]] = milliseconds(std::move(values));
  }
  return out;
}

// One member of every process that has it: {"hp2_player": value, ...}.
Json of_processes(const Json& processes, const char* member) {
  Json out = Json::object();
  if (!processes.is_object()) return out;
  for (const auto& [name, process] : processes.items()) {
    if (process.is_object() && process.contains(member)) out[name] = process[member];
  }
  return out;
}

// A number that the player has reported; -1 if unknown.
std::int64_t of_player(const Json& processes, const char* member, const char* part = nullptr) {
  if (!processes.is_object() || !processes.contains("hp2_player")) return -1;
  const Json* value = &processes["hp2_player"];
  for (const char* key : {member, part}) {
    if (key == nullptr) continue;
    if (!value->is_object() || !value->contains(key)) return -1;
    value = &(*value)[key];
  }
  return value->is_number_integer() ? value->get<std::int64_t>() : -1;
}

}  // namespace

Json make_summary(const SessionView& view, const SessionDigest& digest,
                  const std::optional<GroundTruthComparison>& truth, std::int64_t map_points) {
  const auto poses = static_cast<std::int64_t>(digest.scans.size());
  const std::int64_t scans_in =
      view.scans_in >= 0 ? view.scans_in : (poses == 0 ? 0 : digest.scans.back().sequence + 1);
  std::int64_t accepted = 0;
  for (const auto& c : view.graph.closures) accepted += c.accepted ? 1 : 0;
  std::array<std::int64_t, 3> states{};
  for (const auto& scan : digest.scans)
    ++states[std::min<std::size_t>(static_cast<std::size_t>(scan.state), 2)];

  Json out;
  out["session_id"] = std::to_string(view.session_id);  // a 63-bit number, which JSON readers may round
  out["complete"] = false;                              // until it is known that no scan is missing
  out["scans_in"] = scans_in;
  out["poses_out"] = poses;
  out["scans_skipped"] = digest.scans_skipped;
  out["scans_lost"] = std::max<std::int64_t>(0, scans_in - poses - digest.scans_skipped);
  const std::int64_t damaged = of_player(view.processes, "counters", "scans_damaged");
  out["scans_damaged"] = std::max<std::int64_t>(0, damaged);
  const std::int64_t last = digest.scans.empty() ? -1 : digest.scans.back().sequence;
  out["complete"] = view.graph.ended && poses > 0 && damaged <= 0 && out["scans_lost"] == 0 &&
                    last + 1 >= of_player(view.processes, "total");
  out["submaps"] = view.submap_count;
  out["closures"] = {{"accepted", accepted},
                     {"rejected", static_cast<std::int64_t>(view.graph.closures.size()) - accepted}};
  out["states"] = {{"tracking", states[0]}, {"degenerate", states[1]}, {"lost", states[2]}};
  out["path_m"] = digest.path_m;
  out["drive_s"] = digest.duration_s;
  out["elapsed_s"] = view.elapsed_s > 0 ? Json(view.elapsed_s) : Json();
  out["scans_per_s"] = view.elapsed_s > 0 ? Json(static_cast<double>(poses) / view.elapsed_s) : Json();
  out["map_points"] = map_points >= 0 ? Json(map_points) : Json();
  out["milliseconds"] = stages(digest);
  if (truth) {
    out["accuracy"] = {{"alignment", truth->alignment},
                       {"scans_with_ground_truth", truth->scans.size()},
                       {"final", to_json(truth->corrected)},
                       {"odometry", to_json(truth->odometry)}};
  } else {
    out["accuracy"] = nullptr;
  }
  out["peak_memory_mb"] = of_processes(view.processes, "peak_memory_mb");
  if (view.viewer_peak_memory_mb > 0.0) {
    out["peak_memory_mb"]["hp2_viewer_headless"] = view.viewer_peak_memory_mb;
  }
  out["versions"] = of_processes(view.processes, "version");
  out["versions"]["hp2_viewer_headless"] = version();
  out["counters"] = of_processes(view.processes, "counters");
  out["configuration"] = view.meta;
  out["warnings"] = view.warnings;
  out["processes"] = view.processes;
  return out;
}

std::string dump(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace hp2
