// hp2_viewer_headless: writes map, trajectories, pictures and report of a session, live or afterwards.
#include <algorithm>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "backend/graph/derived.hpp"
#include "common/error.hpp"
#include "common/program.hpp"
#include "common/session/session_store.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/process.hpp"
#include "player/scan_source.hpp"
#include "viewer_headless/process/viewer_process.hpp"

namespace {

using hp2::Error;

// Looks at all submaps for damage. Final poses and edges of a session of before version 4, and damaged ones,
// are computed as the back-end does.
void compute_what_is_not_stored(const hp2::SessionStore& store, hp2::GraphState& graph,
                                std::vector<std::string>& damage) {
  std::vector<hp2::Submap> submaps;
  for (std::int64_t id = 0; id < store.submap_count(); ++id) {
    hp2::Submap submap = store.read_what_is_left(id, damage);
    submap.points = {};
    submap.normals = {};
    submap.scan_indices = {};
    submaps.push_back(std::move(submap));
  }
  submaps.resize(std::min(submaps.size(), graph.map_from_submap.size()));
  if (!graph.odometry.empty() || !graph.trajectory.empty() || submaps.empty()) return;
  graph.odometry = hp2::odometry_edges(submaps);
  graph.trajectory =
      hp2::final_trajectory(submaps, graph, graph.ended && store.read_meta()[hp2::kScansSmoothed] == "yes");
}

// The session of an ended (or interrupted) run, read from its folder.
int write_offline(const std::string& folder, const hp2::ViewerProcessOptions& options,
                  const hp2::ViewerConfig& config) {
  const hp2::SessionStore store(folder, hp2::SessionStore::Access::kReadOnly);
  hp2::SessionView view;
  std::vector<std::string> damage;
  view.session_id = store.session_id();
  view.graph = store.read_graph(hp2::OnDamage::kLeaveOut, &damage);
  view.submap_count = store.submap_count();
  compute_what_is_not_stored(store, view.graph, damage);
  view.read_submap = [&store](std::int64_t id) {
    std::vector<std::string> said;  // it was said when the scans were read
    return store.read_what_is_left(id, said);
  };
  view.ground_truth = hp2::ground_truth_by_sequence(options.ground_truth, view.graph.trajectory);
  view.meta = store.read_meta();
  const auto take_json = [&view](const std::string& key) {
    const auto it = view.meta.find(key);
    auto json = it == view.meta.end()
                    ? nlohmann::ordered_json()
                    : nlohmann::ordered_json::parse(it->second, nullptr, /*allow_exceptions=*/false);
    if (it != view.meta.end()) view.meta.erase(it);
    return json;
  };
  if (auto processes = take_json("processes"); processes.is_object()) view.processes = std::move(processes);
  if (const auto warnings = take_json("warnings"); warnings.is_array()) {
    for (const auto& warning : warnings) {
      if (warning.is_string()) view.warnings.push_back(warning.get<std::string>());
    }
  }
  for (const std::string& text : damage) {
    spdlog::warn("{}", text);
    view.warnings.push_back(text);
  }
  for (const auto& [key, text] : options.meta) view.meta[key] = text;
  view.viewer_peak_memory_mb = hp2::peak_memory_mb();
  for (const auto& name : hp2::write_session(view, options.out_folder, config)) std::puts(name.c_str());
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Writes map, trajectories, pictures and report of a session.", "hp2_viewer_headless");
  hp2::ViewerConfig settings;
  hp2::ViewerProcessOptions options;
  hp2::CommonOptions common;
  hp2::SourceOptions source_options;
  std::string session, truth;
  std::vector<std::string> meta;
  app.add_option("--out", options.out_folder, "Folder to write into; made if it is not there")
      ->type_name("DIR")
      ->required();
  app.add_option("--session", session, "Read this session folder instead of listening to a back-end")
      ->type_name("DIR");
  app.add_option("--live-every", options.live_every_s,
                 "Also write while the drive runs, every S seconds; 0: do not")
      ->type_name("S")
      ->check(CLI::Range(0.0, 1e6));
  app.add_flag("--keep-running", options.keep_running, "Stay when the session has ended");
  app.add_option("--ground-truth", truth,
                 "Drive whose ground truth is drawn and scored against, as hp2_player's DATA")
      ->type_name("DATA");
  app.add_option("--dataset", source_options.dataset, "Format of that drive, if it is not to be recognised")
      ->type_name("NAME");
  app.add_option("--first", source_options.first, "As hp2_player's, for the ground truth")->type_name("N");
  app.add_option("--count", source_options.count, "As hp2_player's, for the ground truth")->type_name("N");
  app.add_option("--stride", source_options.stride, "As hp2_player's, for the ground truth")->type_name("N");
  app.add_option("--topic", source_options.topic, "As hp2_player's, for the ground truth")->type_name("NAME");
  app.add_option("--ground-truth-topic", source_options.ground_truth_topic,
                 "As hp2_player's, for the ground truth")
      ->type_name("NAME");
  app.add_option("--metadata", source_options.metadata, "As hp2_player's, for the ground truth")
      ->type_name("FILE");
  app.add_option("--bin-layout", source_options.bin_layout, "As hp2_player's, for the ground truth")
      ->type_name("NAME");
  app.add_option("--times-unit", source_options.times_unit, "As hp2_player's, for the ground truth")
      ->type_name("UNIT");
  app.add_option("--points-unit", source_options.points_unit, "As hp2_player's, for the ground truth")
      ->type_name("UNIT");
  app.add_flag("--skip-damaged", source_options.skip_damaged, "As hp2_player's, for the ground truth");
  app.add_option("--meta", meta, "A text for the summary, e.g. data=/data/kitti/07; may be repeated")
      ->type_name("KEY=TEXT");
  hp2::add_run_options(app, options.run);
  hp2::add_common_options(app, common, true);
  app.footer(
      "Examples:\n"
      "  hp2_viewer_headless --out out                          follows the session of a running back-end\n"
      "  hp2_viewer_headless --out out --session out/session    afterwards, from disk\n"
      "It owns nothing: it can be started at any time, as often as wanted.");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_viewer_headless", [&] {
    hp2::Config config;
    config.add(hp2::viewer_section(settings));
    if (hp2::apply_common_options(common, &config)) return 0;
    for (const auto& entry : meta) {
      const auto at = entry.find('=');
      if (at == std::string::npos) throw Error("no text is given", "--meta " + entry, "Write KEY=TEXT.");
      options.meta[entry.substr(0, at)] = entry.substr(at + 1);
    }
    hp2::prepare_output_folder(options.out_folder);
    if (!truth.empty()) {
      const auto drive = hp2::open_source(truth, source_options);
      options.ground_truth = drive->ground_truth();
      options.meta.emplace("format", drive->info().format);
      if (!drive->info().sensor.empty()) options.meta.emplace("sensor", drive->info().sensor);
    }
    if (!session.empty()) return write_offline(session, options, settings);
    hp2::catch_stop_signals();
    hp2::LcmBus bus(common.lcm_url);
    hp2::ViewerProcess viewer(bus, settings, options);
    bus.run([&] { return viewer.tick(); });
    return viewer.exit_status();
  });
}
