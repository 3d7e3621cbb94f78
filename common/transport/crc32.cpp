#include "common/transport/crc32.hpp"

#include <libdeflate.h>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace hp2 {
namespace {

#if defined(__x86_64__)
constexpr std::size_t kFold = 256;  // bytes

// Folds all of the data (a multiple of kFold bytes) into the last kFold bytes' place, which have the same CRC
// then. libdeflate 1.14 multiplies 16 bytes at a time; this four times as wide, and four of them (Gopal et
// al., "Fast CRC Computation for Generic Polynomials Using PCLMULQDQ Instruction", 2009).
__attribute__((target("avx512f,vpclmulqdq"))) std::uint32_t fold(const std::uint8_t* data, std::size_t size,
                                                                 std::uint32_t before) {
  // x^(2048 + 32) and x^(2048 - 32) modulo the polynomial, bits reversed.
  const __m512i k = _mm512_set4_epi64(0x1322d1430, 0x11542778a, 0x1322d1430, 0x11542778a);
  __m512i v[4];
  for (std::size_t i = 0; i < 4; ++i) v[i] = _mm512_loadu_si512(data + 64 * i);
  v[0] = _mm512_xor_si512(v[0], _mm512_zextsi128_si512(_mm_cvtsi32_si128(static_cast<int>(~before))));
  for (std::size_t at = kFold; at < size; at += kFold) {
    for (std::size_t i = 0; i < 4; ++i) {
      const __m512i low = _mm512_clmulepi64_epi128(v[i], k, 0x00),
                    high = _mm512_clmulepi64_epi128(v[i], k, 0x11);
      v[i] = _mm512_ternarylogic_epi64(low, high, _mm512_loadu_si512(data + at + 64 * i), 0x96);
    }
  }
  alignas(64) std::uint8_t folded[kFold];
  for (std::size_t i = 0; i < 4; ++i) _mm512_store_si512(folded + 64 * i, v[i]);
  return libdeflate_crc32(~0U, folded, kFold);
}

bool can_fold() {
  static const bool can = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("vpclmulqdq") != 0;
  return can;
}
#endif

}  // namespace

std::uint32_t crc32(const void* data, std::size_t size, std::uint32_t before) {
#if defined(__x86_64__)
  if (size >= 2 * kFold && can_fold()) {
    const auto* bytes = static_cast<const std::uint8_t*>(data);
    const std::size_t folded = size / kFold * kFold;
    return libdeflate_crc32(fold(bytes, folded, before), bytes + folded, size - folded);
  }
#endif
  return libdeflate_crc32(before, data, size);
}

}  // namespace hp2
