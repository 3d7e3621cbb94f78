#include "common/program.hpp"

#include <malloc.h>
#include <sys/resource.h>

#include <cstdio>
#include <exception>
#include <vector>

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include "common/config.hpp"
#include "common/error.hpp"

namespace hp2 {

int run_program(const std::string& name, const std::function<int()>& body) {
  // Scans come and go by the megabyte: memory that was given back to the kernel costs a page fault each 4 kB when
  // the next one arrives.
  constexpr int kKeptBlock = 32 << 20, kKeptMemory = 64 << 20;
  mallopt(M_MMAP_THRESHOLD, kKeptBlock);
  mallopt(M_TRIM_THRESHOLD, kKeptMemory);
  spdlog::set_default_logger(spdlog::stderr_color_mt(name));
  spdlog::set_pattern("%H:%M:%S.%e %n %^%l%$: %v");
  try {
    return body();
  } catch (const Error& e) {
    std::fprintf(stderr, "%s: error: %s\n", name.c_str(), e.what());
    return 1;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: unexpected error: %s. This is a defect: please report it with the command line.\n",
                 name.c_str(), e.what());
    return 70;
  }
}

void set_log_level(const std::string& level) {
  static const std::vector<std::string> kLevels{"trace", "debug", "info", "warn", "error", "off"};
  for (const auto& known : kLevels) {
    if (level == known) {
      spdlog::set_level(spdlog::level::from_str(level));
      return;
    }
  }
  throw Error("unknown log level \"" + level + "\"", "--log-level",
              "Did you mean \"" + nearest_word(level, kLevels) + "\"?");
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

std::string version() { return HP2_VERSION; }

}  // namespace hp2
