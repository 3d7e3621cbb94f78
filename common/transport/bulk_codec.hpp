// Encoding and decoding of the two message types that carry a sensor's megabytes: scan_t and chunk_t. The
// bytes are lcm-gen's; its own code goes through a scan float by float and copies a piece's bytes twice.
#pragma once
#include <optional>

#include "common/scan.hpp"
#include "common/transport/byte_vector.hpp"
#include "common/transport/layout.hpp"
#include "common/transport/limits.hpp"

namespace hp2 {

/// A scan as scan_t for session 0 ("whichever the receiver runs").
/// @param crc takes the bytes' CRC-32 if it is not null, summed while they are in the processor's cache
ByteVector encode_scan(const Scan& scan, std::uint32_t* crc = nullptr);
/// @param used_up a scan that is no longer needed: its memory is used again
/// @param intensity whether the points' intensities are taken along
/// @return nothing if the bytes are not a scan_t, its arrays do not fit together, or its times are
/// impossible
std::optional<Scan> decode_scan(const std::uint8_t* data, std::size_t size, Scan used_up = {},
                                bool intensity = true);

/// What comes before the bytes of an encoded chunk_t; `chunk.data` does not matter, `chunk.size` does.
ByteVector encode_chunk_head(const chunk_t& chunk);
/// Bytes of encode_chunk_head().
std::size_t chunk_head_size();
/// A received chunk_t; its bytes stay where they were received.
struct ChunkView {
  chunk_t fields{};  ///< Without its data.
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
};
/// @return nothing for bytes that are no chunk_t
std::optional<ChunkView> view_chunk(const std::uint8_t* data, std::size_t size);

}  // namespace hp2
