#include "common/transport/crc32.hpp"

#include <array>
#include <cstring>

namespace hp2 {
namespace {

constexpr std::size_t kSlices = 16;
using Tables = std::array<std::array<std::uint32_t, 256>, kSlices>;

// tables[k][b]: what byte b contributes after k more bytes have followed it.
constexpr Tables make_tables() {
  Tables t{};
  for (std::uint32_t b = 0; b < 256; ++b) {
    std::uint32_t c = b;
    for (int bit = 0; bit < 8; ++bit) c = (c & 1U) != 0 ? 0xEDB88320U ^ (c >> 1U) : c >> 1U;
    t[0][b] = c;
  }
  for (std::size_t k = 1; k < kSlices; ++k) {
    for (std::uint32_t b = 0; b < 256; ++b) t[k][b] = (t[k - 1][b] >> 8U) ^ t[0][t[k - 1][b] & 0xFFU];
  }
  return t;
}

constexpr Tables kTables = make_tables();

}  // namespace

std::uint32_t crc32(const void* data, std::size_t size) {
  const auto* p = static_cast<const std::uint8_t*>(data);
  std::uint32_t crc = 0xFFFFFFFFU;
  for (; size >= kSlices; size -= kSlices, p += kSlices) {
    std::array<std::uint32_t, 4> words{};
    std::memcpy(words.data(), p, kSlices);  // little-endian, as all machines we build for
    words[0] ^= crc;
    crc = 0;
    for (std::size_t w = 0; w < 4; ++w) {
      for (std::size_t b = 0; b < 4; ++b)
        crc ^= kTables[kSlices - 1 - (4 * w + b)][(words[w] >> (8U * b)) & 0xFFU];
    }
  }
  for (; size > 0; --size, ++p) crc = (crc >> 8U) ^ kTables[0][(crc ^ *p) & 0xFFU];
  return ~crc;
}

}  // namespace hp2
