// hp2_bench: the front-end alone, in one process, without LCM. What is compared with other systems.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

#include "common/config.hpp"
#include "common/error.hpp"
#include "common/evaluation/consistency.hpp"
#include "common/evaluation/metrics.hpp"
#include "common/program.hpp"
#include "frontend/frontend.hpp"
#include "player/scan_source.hpp"

namespace hp2 {
namespace {

struct Options {
  std::string data, dataset, sweep = "auto", mode, config, poses, json;
  std::vector<std::string> settings;
  int threads = 2;
  std::size_t first = 0, count = 0, stride = 1;
  std::size_t drop = 0;
  double drop_share = 0.0;
  unsigned drop_seed = 1;
  int kitti_correction = -1;
};

// What the front-end said of each scan, in order.
struct Estimates {
  std::vector<Pose> poses;
  std::vector<Matrix6d> covariances;  // of the motion from the scan before
  std::vector<std::int64_t> ends_us;
};

struct StageStatistics {
  double mean = 0.0, median = 0.0, p99 = 0.0;
};

StageStatistics stage_statistics(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  double sum = 0.0;
  for (const double v : values) sum += v;
  const auto last = static_cast<double>(values.size() - 1);
  return {sum / static_cast<double>(values.size()), values[static_cast<std::size_t>(std::lround(0.5 * last))],
          values[static_cast<std::size_t>(std::lround(0.99 * last))]};
}

/// Scans that are handed to the front-end: all but every drop-th, and but a random share.
std::vector<std::size_t> kept_scans(std::size_t n, const Options& options) {
  std::mt19937 random(options.drop_seed);
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < n; ++i) {
    const double draw = static_cast<double>(random()) / 4294967296.0;
    if (draw < options.drop_share || (options.drop > 0 && i % options.drop == options.drop - 1)) continue;
    kept.push_back(i);
  }
  return kept;
}

/// Normalised error squared a scan pair; null if none has ground truth for both scans.
nlohmann::ordered_json score_covariances(const std::map<std::int64_t, Pose>& truth,
                                         const Estimates& estimates) {
  std::vector<double> errors;
  int impossible = 0;  // covariances that are none
  for (std::size_t i = 1; i < estimates.poses.size(); ++i) {
    const auto before = truth.find(estimates.ends_us[i - 1]), at = truth.find(estimates.ends_us[i]);
    if (before == truth.end() || at == truth.end()) continue;
    const double error =
        normalised_errors_squared({before->second, at->second}, {estimates.poses[i - 1], estimates.poses[i]},
                                  {estimates.covariances[i - 1], estimates.covariances[i]})[0];
    if (std::isfinite(error))
      errors.push_back(error);
    else
      ++impossible;
  }
  if (impossible > 0)
    spdlog::warn("{} covariances are not positive definite and left out of the mean", impossible);
  if (errors.empty()) return nullptr;
  const ErrorStatistics s = statistics(errors);
  return {{"mean", s.mean}, {"median", s.median}, {"pairs", s.n}};
}

/// ATE and KITTI drift of the poses that the drive has ground truth for; null if these are fewer than 3.
nlohmann::ordered_json score(const std::map<std::int64_t, Pose>& truth, const Estimates& estimates) {
  std::vector<Pose> reference, estimate;
  for (std::size_t i = 0; i < estimates.poses.size(); ++i) {
    const auto match = truth.find(estimates.ends_us[i]);
    if (match == truth.end()) continue;
    reference.push_back(match->second);
    estimate.push_back(estimates.poses[i]);
  }
  if (reference.size() < 3) return nullptr;
  const Trajectory a = make_trajectory(reference), b = make_trajectory(estimate);
  try {
    auto scores = to_json(evaluate(a, b, Alignment::kSe3));
    scores["alignment"] = "se3";
    return scores;
  } catch (const Error&) {  // a drive along one straight line does not fix the rotation
    auto scores = to_json(evaluate(a, b, Alignment::kOrigin));
    scores["alignment"] = "origin";
    return scores;
  }
}

int run(const Options& options) {
  FrontendConfig settings;
  Config config;
  config.add(frontend_section(settings));
  config.add(sensor_section(settings.sensor));
  config.ignore({"player", "backend", "viewer"});
  if (!options.config.empty()) config.load(options.config);
  for (const auto& assignment : options.settings) config.set(assignment);
  if (!options.mode.empty()) settings.mode = options.mode;

  SourceOptions source_options;
  source_options.dataset = options.dataset;
  source_options.sweep = options.sweep;
  source_options.kitti_correction = options.kitti_correction;
  leave_angles_to(settings.sensor, source_options);
  source_options.first = options.first;
  source_options.count = options.count;
  source_options.stride = options.stride;
  const auto source = open_source(options.data, source_options);
  for (const auto& w : source->warnings()) spdlog::warn("{}", w);

  // Total first: the order of the table.
  const std::vector<std::pair<std::string, std::size_t>> stages{
      {"total", 5},     {"preprocess", 0}, {"neighbour_search", 1},
      {"planarity", 2}, {"solve", 3},      {"map_update", 4}};
  Frontend frontend(settings, options.threads);
  std::vector<std::vector<double>> ms(6);
  Estimates estimates;
  double points = 0.0, iterations = 0.0;
  int degenerate = 0, lost = 0;
  std::vector<std::int64_t> sequences;  // rising
  const std::vector<std::size_t> kept = kept_scans(source->size(), options);
  if (kept.empty())
    throw Error("no scan is left", "--drop, --drop-share", "Drop fewer of the drive's scans.");
  for (const std::size_t i : kept) {
    const FrontendOutput out = frontend.process(source->read(i));
    for (std::size_t s = 0; s < ms.size(); ++s) ms[s].push_back(out.odometry.diagnostics.ms[s]);
    estimates.poses.push_back(out.odometry.odom_from_sensor);
    estimates.covariances.push_back(out.odometry.covariance);
    estimates.ends_us.push_back(out.odometry.utime);
    sequences.push_back(out.odometry.sequence);
    for (const OdometryResult& r : out.revised) {
      const auto at = std::lower_bound(sequences.begin(), sequences.end(), r.sequence) - sequences.begin();
      estimates.poses[static_cast<std::size_t>(at)] = r.odom_from_sensor;
      estimates.covariances[static_cast<std::size_t>(at)] = r.covariance;
    }
    points += out.odometry.n_points;
    iterations += out.odometry.diagnostics.iterations;
    degenerate += out.odometry.state == TrackingState::kDegenerate ? 1 : 0;
    lost += out.odometry.state == TrackingState::kLost ? 1 : 0;
    for (const auto& w : frontend.take_warnings()) spdlog::warn("{}", w);
  }

  std::map<std::int64_t, Pose> truth;
  for (const StampedPose& p : source->ground_truth()) truth[p.utime] = p.pose;
  const std::vector<Pose>& poses = estimates.poses;
  const auto scans = static_cast<double>(poses.size());
  std::printf("%s: %zu scans of %.0f points, mode %s, %d thread%s\n", source->info().name.c_str(),
              poses.size(), points / scans, settings.mode.c_str(), options.threads,
              options.threads == 1 ? "" : "s");
  std::printf("%-17s %9s %9s %9s   (ms a scan, reading excluded)\n", "", "mean", "median", "p99");
  nlohmann::ordered_json report{{"scans", poses.size()}, {"threads", options.threads}};
  for (const auto& [name, index] : stages) {
    const StageStatistics s = stage_statistics(ms[index]);
    std::printf("%-17s %9.3f %9.3f %9.3f\n", name.c_str(), s.mean, s.median, s.p99);
    report[name] = {{"mean", s.mean}, {"median", s.median}, {"p99", s.p99}};
  }
  std::printf("iterations %.1f a scan; degenerate %d, lost %d; peak memory %.0f MB\n", iterations / scans,
              degenerate, lost, peak_memory_mb());
  const nlohmann::ordered_json accuracy = score(truth, estimates);
  if (!accuracy.is_null()) {
    std::printf("ATE %.3f m (RMSE, %s alignment, %zu poses)", accuracy["ate"]["rmse"].get<double>(),
                accuracy["alignment"].get<std::string>().c_str(), accuracy["ate"]["n"].get<std::size_t>());
    if (accuracy["kitti"]["t_percent"].is_number()) {
      std::printf("; KITTI drift %.3f %%, %.3f deg/100 m", accuracy["kitti"]["t_percent"].get<double>(),
                  accuracy["kitti"]["r_deg_per_100m"].get<double>());
    }
    std::printf("\n");
  }
  const nlohmann::ordered_json nees = score_covariances(truth, estimates);
  if (!nees.is_null()) {
    std::printf(
        "normalised error squared %.2f in the mean of %zu scan pairs (6 is honest), %.2f in the median "
        "(5.35)\n",
        nees["mean"].get<double>(), nees["pairs"].get<std::size_t>(), nees["median"].get<double>());
  }
  report["accuracy"] = accuracy;
  report["normalised_error_squared"] = nees;
  report["mode"] = settings.mode;
  report["data"] = source->info().name;
  report["points_per_scan"] = points / scans;
  report["iterations_per_scan"] = iterations / scans;
  report["degenerate"] = degenerate;
  report["lost"] = lost;
  report["peak_memory_mb"] = peak_memory_mb();
  if (!options.poses.empty())
    write_trajectory(options.poses, make_trajectory(poses), TrajectoryFormat::kKitti);
  if (!options.json.empty()) {
    std::ofstream out(options.json);
    out << report.dump(2) << "\n";
    out.close();
    if (!out)
      throw Error("the figures cannot be written", options.json,
                  "Check the folder's rights and the disk's space.");
  }
  return 0;
}

}  // namespace
}  // namespace hp2

int main(int argc, char** argv) {
  hp2::Options options;
  CLI::App app{
      "Runs the front-end alone over a drive and prints milliseconds a scan by stage.\n"
      "Examples:\n"
      "  hp2_bench synthetic:loop --threads 2\n"
      "  hp2_bench /data/kitti/sequences/00 --mode point_to_point --out poses.txt --json bench.json"};
  app.add_option("data", options.data, "Drive: a folder, or synthetic:SCENE[:SEED]")->required();
  app.add_option("--threads", options.threads, "Threads of the registration")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  app.add_option("--mode", options.mode, "Residuals (default: the configuration's)")
      ->check(CLI::IsMember(hp2::frontend_modes()));
  app.add_option("--first", options.first, "Skip so many scans");
  app.add_option("--count", options.count, "Take at most so many scans (0: all)");
  app.add_option("--stride", options.stride, "Take every N-th scan")->check(CLI::PositiveNumber);
  app.add_option("--drop", options.drop, "Drop every N-th scan (0: none)")
      ->check(CLI::Range(std::size_t{0}, std::size_t{1'000'000}));
  app.add_option("--drop-share", options.drop_share, "Drop this share of the scans at random")
      ->check(CLI::Range(0.0, 0.95));
  app.add_option("--drop-seed", options.drop_seed, "Seed of which ones")->capture_default_str();
  app.add_option("--dataset", options.dataset, "Format (default: recognised from the folder)");
  app.add_option("--sweep", options.sweep, "How the points lie in the sweep, as hp2_player has it")
      ->type_name("NAME")
      ->capture_default_str();
  app.add_option(
         "--vertical-correction", options.kitti_correction,
         "Raise the vertical angles by 0.205 degrees, as KITTI's HDL-64E needs it: auto (if the scans "
         "are KITTI's), on, off")
      ->type_name("auto|on|off")
      ->transform(CLI::Transformer(std::map<std::string, int>{{"auto", -1}, {"on", 1}, {"off", 0}}));
  app.add_option("--config", options.config, "YAML file with sections \"frontend\" and \"sensor\"");
  app.add_option(
         "--set", options.settings,
         "One setting, over the file's: section.key=value, e.g. frontend.tau_ref=0.1; may be given again")
      ->type_name("KEY=VALUE")
      ->take_all()
      ->expected(1);
  app.add_option("--out", options.poses, "Write the poses (KITTI format, sensor at sweep end)");
  app.add_option("--json", options.json, "Write the figures as JSON");
  app.set_version_flag("--version", hp2::version());
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_bench", [&] { return hp2::run(options); });
}
