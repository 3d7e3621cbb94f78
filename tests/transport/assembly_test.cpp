#include "common/transport/assembly.hpp"

#include <algorithm>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "common/transport/crc32.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kPiece = 1000;

ByteVector some_bytes(std::size_t size, unsigned seed) {
  std::mt19937 random(seed);
  ByteVector bytes(size);
  for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
  return bytes;
}

// The pieces of a message as they are received.
std::vector<ChunkView> pieces_of(const ByteVector& bytes) {
  std::vector<ChunkView> pieces((bytes.size() + kPiece - 1) / kPiece);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    ChunkView& piece = pieces[i];
    piece.data = bytes.data() + i * kPiece;
    piece.size = std::min(kPiece, bytes.size() - i * kPiece);
    piece.fields.sender_id = 5;
    piece.fields.index = static_cast<std::int32_t>(i);
    piece.fields.count = static_cast<std::int32_t>(pieces.size());
    piece.fields.offset = static_cast<std::int32_t>(i * kPiece);
    piece.fields.size = static_cast<std::int32_t>(piece.size);
    piece.fields.total_size = static_cast<std::int32_t>(bytes.size());
    piece.fields.crc32 = static_cast<std::int32_t>(crc32(bytes.data(), bytes.size()));
  }
  return pieces;
}

TEST(Assembly, IsIntactInWhateverOrderThePiecesCome) {
  const ByteVector bytes = some_bytes(7'300, 1);
  std::vector<ChunkView> pieces = pieces_of(bytes);
  std::mt19937 random(2);
  for (int round = 0; round < 50; ++round) {
    Assembly assembly;
    for (const ChunkView& piece : pieces) {
      EXPECT_FALSE(assembly.whole());
      if (!assembly.same_edition(piece.fields)) assembly.begin(piece.fields);
      assembly.take(piece);
    }
    EXPECT_TRUE(assembly.whole());
    EXPECT_TRUE(assembly.intact());
    EXPECT_EQ(*assembly.bytes, bytes);
    std::shuffle(pieces.begin(), pieces.end(), random);
  }
}

TEST(Assembly, OneWrongByteIsNoticedWhereverItIs) {
  const ByteVector bytes = some_bytes(3'500, 3);
  for (const bool backwards : {false, true}) {
    for (const std::size_t wrong : {0U, 999U, 1000U, 2500U, 3499U}) {
      ByteVector damaged = bytes;
      damaged[wrong] ^= 1U;
      std::vector<ChunkView> pieces = pieces_of(damaged);
      if (backwards) std::reverse(pieces.begin(), pieces.end());
      Assembly assembly;
      for (ChunkView& piece : pieces) {
        piece.fields.crc32 = static_cast<std::int32_t>(crc32(bytes.data(), bytes.size()));
        if (!assembly.same_edition(piece.fields)) assembly.begin(piece.fields);
        assembly.take(piece);
      }
      EXPECT_TRUE(assembly.whole());
      EXPECT_FALSE(assembly.intact()) << wrong;
    }
  }
}

// A piece that lies over another one, from somebody who does not mean well.
TEST(Assembly, WhatWasSummedAndThenOverwrittenIsSummedAgain) {
  const ByteVector bytes = some_bytes(3'000, 4);
  std::vector<ChunkView> pieces = pieces_of(bytes);
  Assembly assembly;
  assembly.begin(pieces[0].fields);
  assembly.take(pieces[0]);
  assembly.take(pieces[1]);
  pieces[2].fields.offset = 500;
  assembly.take(pieces[2]);
  EXPECT_TRUE(assembly.whole());
  EXPECT_FALSE(assembly.intact());
}

TEST(Assembly, AnotherEditionBeginsAnewAndFirstPieceStaysAskedFor) {
  const ByteVector old_bytes = some_bytes(3'000, 5), new_bytes = some_bytes(2'000, 6);
  const auto old_pieces = pieces_of(old_bytes), new_pieces = pieces_of(new_bytes);
  Assembly assembly;
  assembly.pieces[0].state = Piece::State::kAsked;
  assembly.begin(old_pieces[1].fields);
  EXPECT_EQ(assembly.pieces[0].state, Piece::State::kAsked);
  assembly.take(old_pieces[1]);
  assembly.take(old_pieces[0]);
  EXPECT_FALSE(assembly.same_edition(new_pieces[0].fields));
  assembly.begin(new_pieces[0].fields);
  for (const ChunkView& piece : new_pieces) assembly.take(piece);
  EXPECT_TRUE(assembly.intact());
  EXPECT_EQ(*assembly.bytes, new_bytes);
}

}  // namespace
}  // namespace hp2
