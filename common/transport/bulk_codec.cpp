#include "common/transport/bulk_codec.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "common/error.hpp"
#include "common/transport/convert_checks.hpp"
#include "common/transport/crc32.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kWord = 4, kFingerprint = 8;

#if defined(__x86_64__)
// As many words as fill vectors of eight, where the processor has them; how many that were.
__attribute__((target("avx2"))) std::size_t copy_swapped_by_8(const std::uint8_t* in, std::size_t words,
                                                              std::uint8_t* out) {
  const __m256i order =
      _mm256_broadcastsi128_si256(_mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12));
  std::size_t i = 0;
  for (; i + 8 <= words; i += 8) {
    const __m256i v = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(in + kWord * i));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + kWord * i), _mm256_shuffle_epi8(v, order));
  }
  return i;
}
#endif

// Words of 4 bytes with their bytes the other way round (LCM's numbers are big-endian).
void copy_swapped(const void* from, std::size_t words, void* to) {
  using Word4 = std::uint32_t __attribute__((vector_size(16)));  // portable: no processor is too old
  const auto* in = static_cast<const std::uint8_t*>(from);
  auto* out = static_cast<std::uint8_t*>(to);
  std::size_t i = 0;
#if defined(__x86_64__)
  static const bool by_8 = __builtin_cpu_supports("avx2") != 0;
  if (by_8) i = copy_swapped_by_8(in, words, out);
#endif
  for (; i + 4 <= words; i += 4) {
    Word4 v;
    std::memcpy(&v, in + kWord * i, sizeof(v));
    v = (v << 24U) | ((v << 8U) & 0xFF0000U) | ((v >> 8U) & 0xFF00U) | (v >> 24U);
    std::memcpy(out + kWord * i, &v, sizeof(v));
  }
  for (; i < words; ++i) {
    std::uint32_t v = 0;
    std::memcpy(&v, in + kWord * i, sizeof(v));
    v = __builtin_bswap32(v);
    std::memcpy(out + kWord * i, &v, sizeof(v));
  }
}

// Writes the words of a message one after another and sums them.
class SummedWords {
 public:
  // After the bytes [begin, to).
  SummedWords(const std::uint8_t* begin, std::uint8_t* to)
      : to_(to), crc_(crc32(begin, static_cast<std::size_t>(to - begin))) {}

  void put(std::uint32_t value) { put(&value, 1); }
  void put(const std::vector<float>& values) {
    for (std::size_t i = 0; i < values.size(); i += kSlice)
      put(values.data() + i, std::min(kSlice, values.size() - i));
  }
  std::uint32_t crc() const { return crc_; }

 private:
  static constexpr std::size_t kSlice = 2048;  // words that are in the first cache when they are summed

  void put(const void* from, std::size_t words) {
    copy_swapped(from, words, to_);
    crc_ = crc32(to_, kWord * words, crc_);
    to_ += kWord * words;
  }

  std::uint8_t* to_;
  std::uint32_t crc_;
};

void put_word(std::uint32_t value, std::uint8_t* to) { copy_swapped(&value, 1, to); }

std::size_t take_count(const std::uint8_t*& from) {
  std::uint32_t count = 0;
  copy_swapped(from, 1, &count);
  from += kWord;
  return count;
}

void take_floats(std::size_t n, const std::uint8_t*& from, std::vector<float>& values) {
  values.resize(n);
  copy_swapped(from, n, values.data());
  from += kWord * n;
}

}  // namespace

void check_scan_limits(const Scan& scan, const std::string& where) {
  if (scan.size() <= kMaxScanPoints) return;
  throw Error("a scan has " + std::to_string(scan.size()) + " points, more than the " +
                  std::to_string(kMaxScanPoints) + " that can be sent",
              where, "Thin it out, or split it into several scans, before it is played.");
}

// lcm-gen encodes the fields before the arrays, as a scan without points.
ByteVector encode_scan(const Scan& scan, std::uint32_t* crc) {
  scan_t m{};
  m.utime = scan.utime;
  m.duration = scan.duration_us;
  m.sensor = scan.sensor;
  m.sequence = scan.sequence;
  m.session_id = 0;
  m.n = m.n_intensity = m.n_time = 0;
  const auto empty_size = static_cast<std::size_t>(m.getEncodedSize());
  ByteVector bytes(empty_size + kWord * (3 * scan.size() + scan.intensity.size() + scan.time.size()));
  m.encode(bytes.data(), 0, static_cast<int>(empty_size));
  SummedWords out(bytes.data(), bytes.data() + empty_size - 3 * kWord);
  out.put(static_cast<std::uint32_t>(scan.size()));
  for (const auto* axis : {&scan.x, &scan.y, &scan.z}) out.put(*axis);
  for (const auto* extra : {&scan.intensity, &scan.time}) {
    out.put(static_cast<std::uint32_t>(extra->size()));
    out.put(*extra);
  }
  if (crc != nullptr) *crc = out.crc();
  return bytes;
}

std::optional<Scan> decode_scan(const std::uint8_t* data, std::size_t size, Scan used_up, bool intensity) {
  if (!has_layout<scan_t>(data, size)) return std::nullopt;
  LayoutWalker walker(data + kFingerprint, size - kFingerprint);
  walk_before_points(walker);
  const std::uint8_t* from = walker.position();
  std::vector<std::uint8_t> head(data, from);
  head.resize(head.size() + 3 * kWord);  // no points, no intensities, no times
  scan_t m{};
  m.decode(head.data(), 0, static_cast<int>(head.size()));
  if (!sane_time(m.utime) || m.duration < 0 || m.duration > kLongestSweepUs || m.sequence < -1 ||
      !sane_time(m.sequence)) {
    return std::nullopt;
  }
  const std::size_t n = take_count(from);
  if (n > kMaxScanPoints) return std::nullopt;
  Scan scan = std::move(used_up);
  scan.utime = m.utime;
  scan.duration_us = m.duration;
  scan.sensor = std::move(m.sensor);
  scan.sequence = m.sequence;
  for (auto* axis : {&scan.x, &scan.y, &scan.z}) take_floats(n, from, *axis);
  for (auto* extra : {&scan.intensity, &scan.time}) {
    const std::size_t n_extra = take_count(from);
    if (n_extra != 0 && n_extra != n) return std::nullopt;
    if (extra == &scan.intensity && !intensity) {
      scan.intensity.clear();
      from += kWord * n_extra;
    } else {
      take_floats(n_extra, from, *extra);
    }
  }
  return scan;
}

// lcm-gen encodes and decodes the fields before the data, as a chunk without any.
ByteVector encode_chunk_head(const chunk_t& chunk) {
  chunk_t m = chunk;
  m.size = 0;
  m.data.clear();
  ByteVector head(chunk_head_size());
  m.encode(head.data(), 0, static_cast<int>(head.size()));
  put_word(static_cast<std::uint32_t>(chunk.size), head.data() + head.size() - kWord);
  return head;
}

std::size_t chunk_head_size() {
  static const auto size = static_cast<std::size_t>([] {
    chunk_t empty{};
    empty.size = 0;
    return empty.getEncodedSize();
  }());
  return size;
}

std::optional<ChunkView> view_chunk(const std::uint8_t* data, std::size_t size) {
  if (!has_layout<chunk_t>(data, size)) return std::nullopt;
  const std::size_t head_size = chunk_head_size();
  std::vector<std::uint8_t> head(data, data + head_size - kWord);
  head.resize(head_size);
  ChunkView view;
  view.fields.decode(head.data(), 0, static_cast<int>(head_size));
  view.data = data + head_size;
  view.size = size - head_size;
  view.fields.size = static_cast<std::int32_t>(view.size);
  return view;
}

}  // namespace hp2
