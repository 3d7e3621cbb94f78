#include "common/program.hpp"

#include <csignal>
#include <cstdio>
#include <exception>
#include <malloc.h>
#include <new>
#include <sys/resource.h>
#include <system_error>
#include <vector>

#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include "common/config.hpp"
#include "common/error.hpp"
#include "common/text.hpp"

namespace hp2 {

namespace {

int out_of_memory(const std::string& name) {
  std::fprintf(stderr,
               "%s: error: out of memory (%.0f MB are in use). Free memory or raise the limit (ulimit -v, "
               "the container's); "
               "a larger voxel_size_m, a smaller max_range_m and a larger map_voxel_m need less.\n",
               name.c_str(), peak_memory_mb());
  return 1;
}

}  // namespace

int run_program(const std::string& name, const std::function<int()>& body) {
  // Scans have megabytes: memory returned to the kernel costs a page fault per 4 kB when the next scan
  // arrives.
  constexpr int kKeptBlock = 32 << 20, kKeptMemory = 64 << 20;
  mallopt(M_MMAP_THRESHOLD, kKeptBlock);
  mallopt(M_TRIM_THRESHOLD, kKeptMemory);
  spdlog::set_default_logger(spdlog::stderr_color_mt(name));
  spdlog::set_pattern("%H:%M:%S.%e %n %^%l%$: %v");
  // A write beyond the limit on file sizes fails with a reason, instead of ending the process without one.
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return body();
  } catch (const Error& e) {
    std::fprintf(stderr, "%s: error: %s\n", name.c_str(), e.what());
    return 1;
  } catch (const std::bad_alloc&) {
    return out_of_memory(name);
  } catch (const std::system_error& e) {
    const bool few = e.code() == std::errc::resource_unavailable_try_again ||
                     e.code() == std::errc::too_many_files_open ||
                     e.code() == std::errc::too_many_files_open_in_system;
    std::fprintf(stderr, "%s: error: the system refuses: %s. %s\n", name.c_str(), e.what(),
                 few ? "Allow more threads and open files (ulimit -u, ulimit -n), or end other programs."
                     : "Check permissions, limits and the disk.");
    return 1;
  } catch (const std::exception& e) {
    const std::string what = e.what();  // OpenCV's allocator throws an exception of its own
    const bool no_memory =
        what.find("OpenCV") != std::string::npos && (what.find("Insufficient memory") != std::string::npos ||
                                                     what.find("Failed to allocate") != std::string::npos);
    if (no_memory) return out_of_memory(name);
    std::fprintf(stderr,
                 "%s: unexpected error: %s. This is a defect: please report it with the command line.\n",
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
  throw Error("unknown log level \"" + level + "\"", "--log-level", did_you_mean(level, kLevels));
}

double peak_memory_mb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) / 1024.0;
}

std::string version() { return HP2_VERSION; }

}  // namespace hp2
