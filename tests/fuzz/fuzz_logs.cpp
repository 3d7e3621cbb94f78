// Bytes of a file through the reader of LCM logs, index and scans: read, or refused with an
// Error; nothing else. The reader takes files: the bytes lie in one that exists in memory only.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <sys/mman.h>
#include <unistd.h>

#include "common/error.hpp"
#include "player/readers/drive.hpp"

namespace {

using Open = hp2::Drive (*)(const std::string&, const hp2::SourceOptions&);

void read_all(Open open, const std::string& path) {
  constexpr std::size_t kMostScans = 8;
  try {
    const hp2::Drive drive = open(path, {});
    for (std::size_t i = 0; i < drive.scans.size() && i < kMostScans; ++i) {
      hp2::Scan scan;
      try {
        drive.decode(drive.scans[i], scan);
      } catch (const hp2::Error&) {
        continue;
      }
      if (scan.y.size() != scan.size() || scan.z.size() != scan.size()) std::abort();
    }
  } catch (const hp2::Error&) {
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const int file = ::memfd_create("fuzzed", 0);
  static const std::string path = "/proc/self/fd/" + std::to_string(file);
  if (::ftruncate(file, 0) != 0 || ::pwrite(file, data, size, 0) != static_cast<ssize_t>(size)) std::abort();
  read_all(hp2::open_lcm_log, path);
  return 0;
}
