// Text through the reader of trajectory files: read, or refused with an Error; nothing else.
#include <cstdint>
#include <string>

#include "common/error.hpp"
#include "common/evaluation/trajectory.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    hp2::parse_trajectory(std::string(reinterpret_cast<const char*>(data), size), "fuzzed");
  } catch (const hp2::Error&) {
  }
  return 0;
}
