// Prints what a drive's scans are, one line per scan: start, duration, number of points, and a checksum of
// all arrays. Two drives with the same lines give the same poses.
#include <cinttypes>
#include <cstdio>

#include "common/program.hpp"
#include "common/transport/crc32.hpp"
#include "player/scan_source.hpp"

namespace {

std::uint32_t add(const std::vector<float>& values, std::uint32_t before) {
  return hp2::crc32(values.data(), values.size() * sizeof(float), before);
}

}  // namespace

int main(int argc, char** argv) {
  return hp2::run_program("hp2_scan_digest", [&] {
    hp2::SourceOptions options;
    if (argc > 2) options.topic = argv[2];
    const auto source = hp2::open_source(argc > 1 ? argv[1] : "", options);
    for (const auto& warning : source->warnings()) std::fprintf(stderr, "%s\n", warning.c_str());
    for (std::size_t i = 0; i < source->size(); ++i) {
      const hp2::Scan s = source->read(i);
      const std::uint32_t crc = add(s.time, add(s.intensity, add(s.z, add(s.y, add(s.x, 0)))));
      std::printf("%" PRId64 " %" PRId64 " %zu %zu %08x\n", s.utime, s.duration_us, s.size(), s.time.size(),
                  crc);
    }
    return 0;
  });
}
