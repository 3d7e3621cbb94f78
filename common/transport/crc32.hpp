// CRC-32 of a message (zlib's polynomial), to tell a damaged or mixed-up message from a whole one.
#pragma once
#include <cstddef>
#include <cstdint>

#include <libdeflate.h>

namespace hp2 {

/// CRC-32 as zlib's crc32() computes it.
inline std::uint32_t crc32(const void* data, std::size_t size) { return libdeflate_crc32(0, data, size); }

}  // namespace hp2
