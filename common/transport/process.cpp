#include "common/transport/process.hpp"

#include <csignal>
#include <cstdio>

#include <CLI/CLI.hpp>
#include <spdlog/spdlog.h>

#include "common/program.hpp"
#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

volatile std::sig_atomic_t g_stop_signals = 0;

constexpr int kControlQueue = 32;

}  // namespace

void add_common_options(CLI::App& app, CommonOptions& options, bool configurable) {
  const std::string group = "Common";
  app.add_option(
         "--lcm-url", options.lcm_url,
         "LCM URL; default: environment variable LCM_DEFAULT_URL, else udpm://239.255.76.67:7667?ttl=0 "
         "(nothing leaves this machine)")
      ->type_name("URL")
      ->group(group);
  if (configurable) {
    app.add_option("--config", options.config_path,
                   "YAML file with settings; keys left out keep their defaults")
        ->type_name("FILE")
        ->group(group);
    app.add_flag("--print-config", options.print_config,
                 "Print the settings in use, documented, as YAML and exit")
        ->group(group);
  }
  app.add_option("--log-level", options.log_level, "trace, debug, info, warn, error or off")
      ->type_name("LEVEL")
      ->capture_default_str()
      ->group(group);
  app.set_version_flag("--version", version());
  app.get_option("--version")->group(group);
  app.get_formatter()->column_width(34);
}

void add_run_options(CLI::App& app, RunOptions& options) {
  app.add_option("--session-id", options.session_id,
                 "Take part in this session alone, so that two runs on one LCM network do not mix; 0: in the "
                 "first one "
                 "that is heard")
      ->type_name("ID")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--give-up-after", options.give_up_after_s,
                 "End when nothing has happened for S seconds, saying who is waited for; 0: never, for "
                 "robots that wait "
                 "for a sensor")
      ->type_name("S")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e9));
}

bool apply_common_options(const CommonOptions& options, Config* config,
                          const std::function<void()>& override) {
  set_log_level(options.log_level);
  if (config == nullptr) return false;
  config->ignore(config_section_names());
  if (!options.config_path.empty()) config->load(options.config_path);
  if (override) override();
  if (!options.print_config) return false;
  std::fputs(config->print().c_str(), stdout);
  return true;
}

const std::vector<std::string>& config_section_names() {
  static const std::vector<std::string> kNames{"frontend", "sensor", "backend", "viewer", "player"};
  return kNames;
}

void catch_stop_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { g_stop_signals = g_stop_signals + 1; };
  sigemptyset(&action.sa_mask);
  ::sigaction(SIGINT, &action, nullptr);
  ::sigaction(SIGTERM, &action, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
}

int stop_signals() { return g_stop_signals; }

ControlListener::ControlListener(Endpoint& endpoint, std::string process,
                                 std::function<void(const control_t&, bool)> callback)
    : endpoint_(endpoint), process_(std::move(process)), callback_(std::move(callback)) {
  endpoint_.bus().subscribe(
      kControlChannel, [this](const auto* data, auto size) { on_control(data, size); }, kControlQueue);
}

void ControlListener::on_control(const std::uint8_t* data, std::size_t size) {
  control_t m;
  if (!safe_decode(data, size, m)) return endpoint_.reject(kControlChannel, "not a valid control_t");
  if (m.session_id == 0 || m.session_id != endpoint_.session_id()) {
    return endpoint_.reject(kControlChannel,
                            "a command of another session (" + std::to_string(m.session_id) + ")");
  }
  if (!m.target.empty() && m.target != process_) return;
  if (m.command < control_t::PAUSE || m.command > control_t::EXPORT) {
    return endpoint_.reject(kControlChannel, "an unknown command");
  }
  spdlog::info("command {} {}", static_cast<int>(m.command), m.argument);
  callback_(m, !m.target.empty());
}

}  // namespace hp2
