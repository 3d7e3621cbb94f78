// Bytes of a file through the readers of .bin (in every layout), .pcd, .ply, .las, .npy, text and gzip: read,
// or refused with an Error; nothing else.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "common/error.hpp"
#include "player/readers/bin_layout.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/point_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  using Parse = void (*)(std::string_view, const std::string&, hp2::PointFile&);
  for (const Parse parse : {Parse(hp2::parse_pcd), Parse(hp2::parse_ply), Parse(hp2::parse_bin),
                            Parse(hp2::parse_las), Parse(hp2::parse_npy), Parse(hp2::parse_text_points)}) {
    hp2::PointFile file;
    try {
      parse(bytes, "fuzzed", file);
    } catch (const hp2::Error&) {
    }
  }
  try {
    hp2::choose_bin_layout({std::string(bytes)}, "fuzzed");
  } catch (const hp2::Error&) {
  }
  try {
    hp2::expand_gzip(bytes, "fuzzed");
  } catch (const hp2::Error&) {
  }
  return 0;
}
