// A message whose pieces are coming in.
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/transport/bulk_codec.hpp"

namespace hp2 {

/// One piece, as its reader knows it.
struct Piece {
  enum class State : std::uint8_t { kMissing, kAsked, kHave } state = State::kMissing;
  std::uint8_t tries = 0;
  std::int64_t asked_us = 0;
  std::int64_t ask_number = 0;
};

/// The pieces that are here, put together and summed.
struct Assembly {
  std::int64_t id = 0, sender_id = 0;
  std::uint32_t crc = 0;
  std::vector<Piece> pieces{1};  ///< Until the count is known: piece 0.
  bool known = false;            ///< Count, size and crc.
  std::size_t have = 0, have_bytes = 0;
  std::int64_t touched_us = 0;
  std::shared_ptr<ByteVector> bytes;  ///< Memory is touched only as far as pieces arrive.

  /// Whether pieces of this message, in this edition, have been received.
  bool same_edition(const chunk_t& chunk) const;
  /// The first piece, or another edition of the message after its owner was restarted: begins again.
  void begin(const chunk_t& chunk);
  /// Takes a piece that lies inside the message and was not received yet.
  void take(const ChunkView& piece);
  bool whole() const { return known && have == pieces.size(); }
  /// Of a whole message: its checksum is right.
  bool intact() const;

 private:
  // Pieces that come in order are summed while the processor has them in its cache.
  std::size_t summed_ = 0;  // bytes from the beginning
  std::uint32_t sum_ = 0;   // their CRC-32
};

}  // namespace hp2
