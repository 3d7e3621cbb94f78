#include "common/transport/bulk_codec.hpp"

#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "common/transport/convert.hpp"
#include "common/transport/crc32.hpp"

namespace hp2 {
namespace {

TEST(Crc32, IsZlibs) {
  EXPECT_EQ(crc32("123456789", 9), 0xCBF43926U);
  EXPECT_EQ(crc32("", 0), 0U);
  const std::string fox = "The quick brown fox jumps over the lazy dog";
  EXPECT_EQ(crc32(fox.data(), fox.size()), 0x414FA339U);
}

// Long ones are folded; bit by bit is what zlib's sum is defined by.
TEST(Crc32, IsTheSameOfLongDataInPieces) {
  const auto slow = [](const std::uint8_t* data, std::size_t size) {
    std::uint32_t crc = ~0U;
    for (std::size_t i = 0; i < size; ++i) {
      crc ^= data[i];
      for (int bit = 0; bit < 8; ++bit) crc = crc >> 1U ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
    }
    return ~crc;
  };
  std::mt19937 rng(4);
  std::vector<std::uint8_t> data(5000);
  for (auto& b : data) b = static_cast<std::uint8_t>(rng());
  for (std::size_t size = 0; size < data.size(); size += 1 + rng() % 60) {
    const std::uint32_t expected = slow(data.data() + 1, size);
    ASSERT_EQ(crc32(data.data() + 1, size), expected) << size;
    const std::size_t cut = size == 0 ? 0 : rng() % size;
    ASSERT_EQ(crc32(data.data() + 1 + cut, size - cut, crc32(data.data() + 1, cut)), expected)
        << size << ' ' << cut;
  }
}

TEST(BulkCodec, ScansComeBackAsTheyWere) {
  Scan scan;
  scan.sequence = 7;
  scan.utime = 1'600'000'000'000'000;
  scan.duration_us = 100'000;
  scan.sensor = "hdl64";
  scan.x = {1.0F, 2.0F, std::numeric_limits<float>::quiet_NaN()};
  scan.y = {3.0F, 4.0F, 5.0F};
  scan.z = {6.0F, 7.0F, 8.0F};
  scan.time = {0.0F, 0.5F, 1.0F};
  const auto bytes = encode_scan(scan);
  const auto back = decode_scan(bytes.data(), bytes.size());
  ASSERT_TRUE(back);
  EXPECT_EQ(back->sequence, 7);
  EXPECT_EQ(back->utime, scan.utime);
  EXPECT_EQ(back->duration_us, scan.duration_us);
  EXPECT_EQ(back->sensor, scan.sensor);
  EXPECT_EQ(back->y, scan.y);
  EXPECT_EQ(back->time, scan.time);
  EXPECT_TRUE(back->intensity.empty());
  EXPECT_EQ(std::memcmp(back->x.data(), scan.x.data(), 12), 0) << "bits of a NaN, too";
}

// Every length of the arrays, as they are copied by four and eight words; a long one, as they are summed by
// slices.
TEST(BulkCodec, ScansAndPiecesAreTheBytesOfTheirTypes) {
  std::mt19937 rng(9);
  const auto numbers = [&rng](std::size_t n) {
    std::vector<float> v(n);
    for (float& x : v) x = static_cast<float>(rng()) * 1e-6F - 2000.0F;
    return v;
  };
  Scan used_up;  // the scan of another length, with other arrays, whose memory each one takes
  for (const std::size_t n : {9U, 0U, 4U, 1U, 8U, 3U, 2U, 7U, 11U, 5000U, 6U, 5U}) {
    Scan scan;
    scan.sequence = 7;
    scan.utime = 1'600'000'000'000'000;
    scan.duration_us = 100'000;
    scan.sensor = "hdl64";
    scan.x = numbers(n), scan.y = numbers(n), scan.z = numbers(n);
    if (n % 2 == 0) scan.intensity = numbers(n);
    if (n % 3 == 0) scan.time = numbers(n);
    scan_t m{};
    m.utime = scan.utime, m.duration = scan.duration_us, m.sensor = scan.sensor, m.sequence = 7;
    m.n = static_cast<std::int32_t>(n);
    m.x = scan.x, m.y = scan.y, m.z = scan.z;
    m.n_intensity = static_cast<std::int32_t>(scan.intensity.size());
    m.intensity = scan.intensity;
    m.n_time = static_cast<std::int32_t>(scan.time.size());
    m.time = scan.time;
    std::uint32_t crc = 0;
    const ByteVector bytes = encode_scan(scan, &crc);
    EXPECT_EQ(bytes, encode_message(m)) << n << " points";
    EXPECT_EQ(crc, crc32(bytes.data(), bytes.size())) << n << " points";
    const auto back = decode_scan(bytes.data(), bytes.size(), std::move(used_up));
    ASSERT_TRUE(back);
    used_up = *back;
    EXPECT_EQ(back->z, scan.z);
    EXPECT_EQ(back->intensity, scan.intensity);
    EXPECT_EQ(back->time, scan.time);
    const auto less = decode_scan(bytes.data(), bytes.size(), *back, false);
    ASSERT_TRUE(less);
    EXPECT_TRUE(less->intensity.empty());
    EXPECT_EQ(less->time, scan.time);

    chunk_t chunk{};
    chunk.session_id = 1, chunk.sender_id = -2, chunk.message_id = 3, chunk.index = 4, chunk.count = 5;
    chunk.total_size = 600, chunk.offset = 70, chunk.crc32 = -8, chunk.size = static_cast<std::int32_t>(n);
    const ByteVector data(n, 0xC3);
    ByteVector piece = encode_chunk_head(chunk);
    piece.insert(piece.end(), data.begin(), data.end());
    chunk.data.assign(data.begin(), data.end());
    EXPECT_EQ(piece, encode_message(chunk)) << n << " bytes";
    const auto view = view_chunk(piece.data(), piece.size());
    ASSERT_TRUE(view);
    EXPECT_EQ(ByteVector(view->data, view->data + view->size), data);
    chunk.data.clear();
    chunk_t fields = view->fields;
    EXPECT_EQ(fields.size, chunk.size);
    chunk.size = fields.size = 0;
    EXPECT_EQ(encode_message(fields), encode_message(chunk));
    for (std::size_t cut = 0; cut < piece.size(); ++cut) ASSERT_FALSE(view_chunk(piece.data(), cut));
  }
}

TEST(BulkCodec, ArraysThatDoNotFitTogetherAreRefused) {
  scan_t m{};
  m.n = 3;
  m.x = m.y = m.z = {1, 2, 3};
  m.n_time = 2;
  m.time = {0, 1};
  auto bytes = encode_message(m);
  EXPECT_FALSE(decode_scan(bytes.data(), bytes.size()));
  m.n_time = 0;
  m.time.clear();
  m.duration = -1;
  bytes = encode_message(m);
  EXPECT_FALSE(decode_scan(bytes.data(), bytes.size()));
  m.duration = 0;
  m.utime = std::numeric_limits<std::int64_t>::max();
  bytes = encode_message(m);
  EXPECT_FALSE(decode_scan(bytes.data(), bytes.size()));
}

}  // namespace
}  // namespace hp2
