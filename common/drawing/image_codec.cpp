#include "common/drawing/image_codec.hpp"

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <jpeglib.h>
#include <libdeflate.h>
#include <memory>
#include <new>
#include <vector>

namespace hp2 {

namespace {

constexpr std::size_t kChannels = 3;
constexpr int kCompression = 6;  // of 12

void put32(std::string& out, std::uint32_t v) {
  for (int shift = 24; shift >= 0; shift -= 8) out += static_cast<char>(v >> shift & 255U);
}

void put_chunk(std::string& out, const std::string& name, const std::string& data) {
  put32(out, static_cast<std::uint32_t>(data.size()));
  const std::size_t begin = out.size();
  out += name + data;
  put32(out, libdeflate_crc32(0, out.data() + begin, out.size() - begin));
}

// How large what is left of a row after a filter is: the smaller, the better it compresses.
std::size_t size_of(const std::vector<std::uint8_t>& row) {
  std::size_t sum = 0;
  for (const std::uint8_t v : row) sum += static_cast<std::size_t>(std::abs(static_cast<std::int8_t>(v)));
  return sum;
}

// All rows, each as its difference to the pixels on the left or above, with the filter's number before it.
std::vector<std::uint8_t> filtered(const cv::Mat& bgr) {
  const std::size_t width = kChannels * static_cast<std::size_t>(bgr.cols);
  std::vector<std::uint8_t> row(width), above(width, 0), left(width), up(width), out;
  out.reserve((width + 1) * static_cast<std::size_t>(bgr.rows));
  for (int r = 0; r < bgr.rows; ++r) {
    const std::uint8_t* from = bgr.ptr(r);
    for (std::size_t i = 0; i < width; i += kChannels) {
      for (std::size_t k = 0; k < kChannels; ++k) row[i + k] = from[i + kChannels - 1 - k];
    }
    for (std::size_t i = 0; i < width; ++i) {
      left[i] = static_cast<std::uint8_t>(row[i] - (i < kChannels ? 0 : row[i - kChannels]));
      up[i] = static_cast<std::uint8_t>(row[i] - above[i]);
    }
    const bool from_above = size_of(up) < size_of(left);
    const auto& best = from_above ? up : left;
    out.push_back(from_above ? 2 : 1);
    out.insert(out.end(), best.begin(), best.end());
    std::swap(row, above);
  }
  return out;
}

}  // namespace

std::string encode_png(const cv::Mat& bgr) {
  const std::vector<std::uint8_t> rows = filtered(bgr);
  const std::unique_ptr<libdeflate_compressor, void (*)(libdeflate_compressor*)> compressor(
      libdeflate_alloc_compressor(kCompression), libdeflate_free_compressor);
  if (!compressor) throw std::bad_alloc();
  std::string packed(libdeflate_zlib_compress_bound(compressor.get(), rows.size()), '\0');
  packed.resize(
      libdeflate_zlib_compress(compressor.get(), rows.data(), rows.size(), packed.data(), packed.size()));

  std::string header;
  put32(header, static_cast<std::uint32_t>(bgr.cols));
  put32(header, static_cast<std::uint32_t>(bgr.rows));
  header += std::string("\x08\x02\x00\x00\x00", 5);  // 8 bits, RGB, deflated, filtered, not interlaced
  std::string out("\x89PNG\r\n\x1a\n");
  put_chunk(out, "IHDR", header);
  put_chunk(out, "IDAT", packed);
  put_chunk(out, "IEND", "");
  return out;
}

std::string encode_jpeg(const cv::Mat& bgr, int quality) {
  jpeg_compress_struct jpeg;
  jpeg_error_mgr errors;  // ends the process where memory ends: nothing else can fail
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = static_cast<JDIMENSION>(bgr.cols);
  jpeg.image_height = static_cast<JDIMENSION>(bgr.rows);
  jpeg.input_components = kChannels;
  jpeg.in_color_space = JCS_EXT_BGR;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  for (int r = 0; r < bgr.rows; ++r) {
    auto* row = const_cast<JSAMPLE*>(bgr.ptr(r));  // read only, but C has it otherwise
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  const std::unique_ptr<unsigned char, void (*)(void*)> owned(bytes, std::free);
  return {reinterpret_cast<const char*>(bytes), size};
}

}  // namespace hp2
