// hp2_calibrate: estimates a sensor's angle and range errors from a drive.
#include <cstdio>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <spdlog/spdlog.h>

#include "common/atomic_file.hpp"
#include "common/error.hpp"
#include "common/program.hpp"
#include "frontend/frontend.hpp"
#include "player/calibration/calibrate.hpp"
#include "player/calibration/calibration_file.hpp"
#include "player/calibration/find_rings.hpp"
#include "player/readers/file_io.hpp"
#include "player/scan_source.hpp"
#include "player/sweep/sweep_trial.hpp"

namespace hp2 {
namespace {

struct Options {
  std::string data, out, log_level = "info";
  SourceOptions source;
  int threads = 2;
  std::size_t most_windows = 40;
};

std::vector<Scan> some_scans(const ScanSource& source) {
  constexpr std::size_t kScans = 12;
  std::vector<Scan> scans;
  for (std::size_t k = 0; k < std::min(kScans, source.size()); ++k)
    scans.push_back(source.read(k * source.size() / std::min(kScans, source.size())));
  return scans;
}

std::vector<CalibrationWindow> run_odometry(const ScanSource& source, const std::vector<double>& rings,
                                            double scale, const Options& options) {
  WindowConfig config;
  config.spacing_m *= scale;
  WindowCutter cutter(config, rings);
  Frontend frontend(FrontendConfig(), options.threads);
  std::vector<CalibrationWindow> windows;
  for (std::size_t i = 0; i < source.size() && windows.size() < options.most_windows; ++i) {
    const Scan scan = source.read(i);
    const OdometryResult result = frontend.process(scan).odometry;
    if (result.state == TrackingState::kLost) {
      cutter = WindowCutter(config, rings);
      continue;
    }
    if (auto window = cutter.add(scan, result.odom_from_sensor)) windows.push_back(std::move(*window));
  }
  return windows;
}

/// Before minutes are spent. @throws Error if no file can be written to `path`
void check_output(const std::string& path) {
  if (is_folder(path)) throw Error("--out is a folder", path, "Name a file, e.g. sensor.yaml in it.");
  const AtomicFile probe(path);
}

int run(Options options) {
  if (!options.out.empty()) check_output(options.out);
  set_log_level(options.log_level);
  options.source.kitti_correction = std::max(options.source.kitti_correction, 0);
  const auto source = open_source(options.data, options.source);
  for (const std::string& warning : source->warnings()) spdlog::warn("{}", warning);
  const std::vector<Scan> scans = some_scans(*source);
  const std::vector<double> rings = find_rings(scans);
  spdlog::info("{}", rings.empty()
                         ? "rings cannot be told by their vertical angles: one common bias is estimated"
                         : std::to_string(rings.size()) + " rings are told by their vertical angles");
  std::vector<CalibrationWindow> windows =
      run_odometry(*source, rings, scale_of_scene(scans.front()), options);
  const CalibrationConfig config;
  const Parallel parallel(options.threads);
  const CalibrationEstimate estimate =
      calibrate(windows, std::max<std::size_t>(rings.size(), 1), config, parallel);
  std::fputs(describe(estimate, rings).c_str(), stdout);
  std::fflush(stdout);  // before what is said on stderr
  const std::string doubt = doubt_about(estimate, config);
  if (!doubt.empty())
    throw Error(
        "the drive does not determine the calibration: " + doubt, options.data,
        "Record a drive with ground, walls or ceilings at many distances, and curves. Nothing is written.");
  if (!options.out.empty()) write_calibration(options.out, estimate, rings, source->info().name);
  return 0;
}

}  // namespace
}  // namespace hp2

int main(int argc, char** argv) {
  hp2::Options options;
  CLI::App app(
      "Estimates from a drive by how much a sensor's vertical angles and ranges are off: what makes the "
      "map's "
      "planes thinnest.",
      "hp2_calibrate");
  app.add_option("DATA", options.data, "Drive, as hp2_player takes it")->required();
  app.add_option("--out", options.out, "Write the section \"sensor\" for --config to this YAML file")
      ->type_name("FILE");
  app.add_option("--dataset", options.source.dataset, "Format of the drive, if it is not to be recognised")
      ->type_name("NAME");
  app.add_option("--first", options.source.first, "Skip so many scans")->type_name("N");
  app.add_option("--count", options.source.count, "Take at most so many scans; 0: all")->type_name("N");
  app.add_option("--topic", options.source.topic, "As hp2_player's")->type_name("NAME");
  app.add_option("--metadata", options.source.metadata, "As hp2_player's")->type_name("FILE");
  app.add_option("--bin-layout", options.source.bin_layout, "As hp2_player's")->type_name("NAME");
  app.add_option("--sweep", options.source.sweep, "As hp2_player's")
      ->type_name("NAME")
      ->capture_default_str();
  app.add_option("--times-unit", options.source.times_unit, "As hp2_player's")->type_name("UNIT");
  app.add_option("--points-unit", options.source.points_unit, "As hp2_player's")->type_name("UNIT");
  app.add_option("--most-stretches", options.most_windows, "Stretches of the drive that are used at most")
      ->type_name("N")
      ->check(CLI::Range(3, 1000))
      ->capture_default_str();
  app.add_option("--threads", options.threads, "Threads; the result does not depend on their number")
      ->type_name("N")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--log-level", options.log_level, "trace, debug, info, warn, error or off")
      ->type_name("LEVEL")
      ->capture_default_str();
  app.set_version_flag("--version", hp2::version());
  app.footer(
      "Examples:\n"
      "  hp2_calibrate DATA --out sensor.yaml         then: run_slam.sh DATA --config sensor.yaml --out DIR\n"
      "  hp2_calibrate DATA --first 200 --count 600\n"
      "It writes nothing and exits with 1 where the drive does not determine the common vertical angle. "
      "Rings that\n"
      "it does not determine get the common angle alone.");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_calibrate", [&] { return hp2::run(options); });
}
