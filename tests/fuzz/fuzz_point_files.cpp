// Bytes of a file through the readers of .bin, .pcd and .ply: read, or refused with an Error; nothing else.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "common/error.hpp"
#include "player/readers/point_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  using Parse = void (*)(std::string_view, const std::string&, hp2::PointFile&);
  for (const Parse parse : {Parse(hp2::parse_pcd), Parse(hp2::parse_ply), Parse(hp2::parse_bin)}) {
    hp2::PointFile file;
    try {
      parse(bytes, "fuzzed", file);
    } catch (const hp2::Error&) {
    }
  }
  return 0;
}
