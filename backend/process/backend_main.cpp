// hp2_backend: keeps the session, closes loops, publishes the corrected graph.
#include <cstdio>

#include <CLI/CLI.hpp>

#include "backend/process/backend_process.hpp"
#include "common/error.hpp"
#include "common/program.hpp"
#include "common/session/session_check.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/process.hpp"

int main(int argc, char** argv) {
  CLI::App app("Keeps the session on disk, closes loops, and publishes the corrected graph and trajectory.",
               "hp2_backend");
  hp2::BackendConfig settings;
  hp2::BackendProcessOptions options;
  hp2::CommonOptions common;
  std::vector<std::string> meta;
  bool check = false;
  app.add_option("--session", options.session_folder,
                 "Folder of the session; made if it is not there, taken up if it is")
      ->type_name("DIR")
      ->required();
  app.add_flag("--exit-when-done", options.exit_when_done,
               "End when the session is complete and the viewers have written all of it (one at least)");
  app.add_option("--meta", meta, "A text to keep in the session, e.g. data=/data/kitti/07; may be repeated")
      ->type_name("KEY=TEXT");
  app.add_flag(
      "--check", check,
      "Only say whether this session can be begun or gone on with (status 1: it cannot); --meta drive= and "
      "configuration= must then be as they were");
  hp2::add_run_options(app, options.run);
  hp2::add_common_options(app, common, true);
  app.footer(
      "Examples:\n"
      "  hp2_backend --session out/session     begins a session there, or goes on with it after a crash\n"
      "A session that is complete is only shown to viewers; begin a new one in another folder.");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_backend", [&] {
    hp2::Config config;
    config.add(hp2::backend_section(settings));
    if (hp2::apply_common_options(common, &config)) return 0;
    for (const auto& entry : meta) {
      const auto at = entry.find('=');
      if (at == std::string::npos) throw hp2::Error("no text is given", "--meta " + entry, "Write KEY=TEXT.");
      options.meta[entry.substr(0, at)] = entry.substr(at + 1);
    }
    if (check) {
      std::printf("%s\n", hp2::check_session(options.session_folder, options.meta).c_str());
      const std::int64_t id = hp2::stored_session_id(options.session_folder);
      if (id != 0) std::printf("session id %lld\n", static_cast<long long>(id));
      return 0;
    }
    hp2::catch_stop_signals();
    hp2::LcmBus bus(common.lcm_url);
    hp2::BackendProcess backend(bus, settings, options);
    bus.run([&] { return backend.tick(); });
    return backend.exit_status();
  });
}
