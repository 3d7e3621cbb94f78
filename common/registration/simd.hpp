// Four floats of a vector register, whatever the processor (a GNU extension that GCC and Clang share).
#pragma once
#include <cstdint>
#include <cstring>

namespace hp2 {

using Float4 = float __attribute__((vector_size(16)));
using Int4 = std::int32_t __attribute__((vector_size(16)));

/// Loads from any address.
inline Float4 load4(const float* from) {
  Float4 v;
  std::memcpy(&v, from, sizeof(v));
  return v;
}

inline Float4 min4(Float4 a, Float4 b) { return a < b ? a : b; }

inline float sum4(Float4 v) { return (v[0] + v[1]) + (v[2] + v[3]); }

}  // namespace hp2
