// What the programs on the bus share: common options, stop signals, commands.
#pragma once
#include <functional>
#include <string>

#include "common/config.hpp"
#include "common/transport/endpoint.hpp"

namespace CLI {
class App;  // its header costs seconds per file: only those that define options include it
}

namespace hp2 {

/// Options that every program on the bus has.
struct CommonOptions {
  std::string lcm_url;
  std::string config_path;
  std::string log_level = "info";
  bool print_config = false;
};
/// Adds them to a command line.
/// @param configurable adds --config and --print-config
void add_common_options(CLI::App& app, CommonOptions& options, bool configurable);

/// Options of the programs that take part in a session.
struct RunOptions {
  std::int64_t session_id = 0;     ///< This session and no other; 0: the first one that is offered.
  double give_up_after_s = 120.0;  ///< Without any progress; 0: never.
};
/// Adds them to a command line.
void add_run_options(CLI::App& app, RunOptions& options);

/// Sets the log level and reads the configuration file, if one is given; then calls `override`, by which
/// options of the command line win over the file.
/// @return true if --print-config was asked for and served: the program should end
/// @throws Error for a bad level or file
bool apply_common_options(const CommonOptions& options, Config* config,
                          const std::function<void()>& override = {});

/// Names of all sections of the configuration file, so that each program can leave the others' alone.
const std::vector<std::string>& config_section_names();

/// From now on SIGINT and SIGTERM only count; see stop_signals(). SIGPIPE is ignored.
void catch_stop_signals();
/// How many of them were received.
int stop_signals();

/// Listens to CONTROL: commands of this session for this process (or for all). Others are ignored with a
/// message.
class ControlListener {
 public:
  /// @param callback called with control_t's command and argument
  ControlListener(Endpoint& endpoint, std::string process,
                  std::function<void(const control_t& command, bool named)> callback);

 private:
  void on_control(const std::uint8_t* data, std::size_t size);
  Endpoint& endpoint_;
  std::string process_;
  std::function<void(const control_t&, bool)> callback_;
};

}  // namespace hp2
