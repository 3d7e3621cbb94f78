// hp2_frontend: registers scans and cuts submaps.
#include <CLI/CLI.hpp>

#include "common/program.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/process.hpp"
#include "frontend/process/frontend_process.hpp"

int main(int argc, char** argv) {
  CLI::App app(
      "LiDAR odometry: registers the scans that it hears and hands finished submaps to the back-end.",
      "hp2_frontend");
  hp2::FrontendConfig settings;
  hp2::FrontendProcessOptions options;
  hp2::CommonOptions common;
  std::string mode;
  app.add_option("--threads", options.threads, "Threads that register; the result does not depend on it")
      ->type_name("N")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--mode", mode, "Residuals and weights; overrides frontend.mode of the configuration")
      ->type_name("MODE")
      ->check(CLI::IsMember(hp2::frontend_modes()));
  app.add_flag("--standalone", options.standalone,
               "Odometry alone: begin without a back-end, keep no submaps");
  app.add_option(
         "--live-backlog", options.live_backlog,
         "Live scans that may wait; when more come the oldest are dropped and counted. Raise it to replay a "
         "recording faster than it can be registered")
      ->type_name("N")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  hp2::add_run_options(app, options.run);
  hp2::add_common_options(app, common, true);
  app.footer(
      "Examples:\n"
      "  hp2_frontend                          waits for a back-end and for scans\n"
      "  hp2_frontend --config my.yaml --mode point_to_plane\n"
      "  hp2_frontend --standalone             odometry on HP2_ODOMETRY, no map\n"
      "Scans come from hp2_player, or from any program that publishes scan_t on HP2_SCAN.");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_frontend", [&] {
    hp2::Config config;
    config.add(hp2::frontend_section(settings));
    config.add(hp2::sensor_section(settings.sensor));
    const auto override = [&] {
      if (!mode.empty()) settings.mode = mode;
      hp2::validate(settings);
    };
    if (hp2::apply_common_options(common, &config, override)) return 0;
    hp2::catch_stop_signals();
    hp2::LcmBus bus(common.lcm_url);
    hp2::FrontendProcess frontend(bus, settings, options);
    bus.run([&] { return frontend.tick(); });
    return frontend.exit_status();
  });
}
