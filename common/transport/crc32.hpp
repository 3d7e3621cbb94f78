// CRC-32 of a message (zlib's polynomial), to tell a damaged or mixed-up message from a whole one.
#pragma once
#include <cstddef>
#include <cstdint>

namespace hp2 {

/// CRC-32 as zlib's crc32() computes it.
/// @param before of the bytes before `data`
std::uint32_t crc32(const void* data, std::size_t size, std::uint32_t before = 0);

}  // namespace hp2
