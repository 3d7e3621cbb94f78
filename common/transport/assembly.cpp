#include "common/transport/assembly.hpp"

#include <cstring>

#include "common/transport/crc32.hpp"

namespace hp2 {

bool Assembly::same_edition(const chunk_t& chunk) const {
  return known && crc == static_cast<std::uint32_t>(chunk.crc32) &&
         bytes->size() == static_cast<std::size_t>(chunk.total_size) &&
         pieces.size() == static_cast<std::size_t>(chunk.count) && sender_id == chunk.sender_id;
}

void Assembly::begin(const chunk_t& chunk) {
  const bool first_asked = !known && pieces[0].state == Piece::State::kAsked;
  const Piece first = pieces[0];
  pieces.assign(static_cast<std::size_t>(chunk.count), Piece{});
  if (first_asked) pieces[0] = first;
  known = true;
  crc = static_cast<std::uint32_t>(chunk.crc32);
  sender_id = chunk.sender_id;
  have = have_bytes = summed_ = 0;
  sum_ = 0;
  bytes = std::make_shared<ByteVector>(static_cast<std::size_t>(chunk.total_size));
}

void Assembly::take(const ChunkView& piece) {
  const auto offset = static_cast<std::size_t>(piece.fields.offset);
  pieces[static_cast<std::size_t>(piece.fields.index)].state = Piece::State::kHave;
  ++have;
  have_bytes += piece.size;
  std::memcpy(bytes->data() + offset, piece.data, piece.size);
  if (offset < summed_) summed_ = sum_ = 0;  // what was summed is overwritten
  if (offset != summed_) return;
  sum_ = crc32(piece.data, piece.size, sum_);
  summed_ += piece.size;
}

bool Assembly::intact() const {
  const std::size_t size = bytes->size();
  return have_bytes == size && crc32(bytes->data() + summed_, size - summed_, sum_) == crc;
}

}  // namespace hp2
