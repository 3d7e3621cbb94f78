// What ROS 1 bags and MCAP have in common: a file of records, some of them chunks that hold records
// themselves.
#pragma once
#include <cstdint>
#include <cstring>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "player/readers/bags/bag_file.hpp"

namespace hp2 {

/// A little-endian number off the front of `bytes`; 0 if there are too few.
template <typename T>
T little_endian(std::string_view bytes) {
  T value{};
  if (bytes.size() >= sizeof(T)) std::memcpy(&value, bytes.data(), sizeof(T));
  return value;
}

/// A stretch of the file with records in it.
struct Chunk {
  std::uint64_t at = 0;        ///< Of its bytes in the file.
  std::uint64_t size = 0;      ///< As stored [bytes].
  std::uint64_t expanded = 0;  ///< As its header says [bytes].
  Compression compression = Compression::kNone;
  std::uint32_t crc = 0;  ///< Of the expanded bytes; 0: not known.
};

/// The bytes of a file and of its chunks. Chunks that were expanded last are kept. Thread-safe.
class ChunkedFile {
 public:
  explicit ChunkedFile(std::shared_ptr<const PartFile> file);

  const PartFile& file() const { return *file_; }
  /// The whole file is chunk 0.
  const Chunk& chunk(std::uint32_t index) const { return chunks_.at(index); }
  std::uint32_t size() const { return static_cast<std::uint32_t>(chunks_.size()); }
  std::uint32_t add(const Chunk& chunk);

  /// Bytes [offset, offset + n) of the expanded chunk; fewer where it ends or is damaged.
  std::string_view read(std::uint32_t chunk, std::uint64_t offset, std::size_t n, MessageBytes& memory) const;
  /// Bytes that the whole chunk has when it is expanded, as far as it can be.
  std::uint64_t expanded_size(std::uint32_t chunk, MessageBytes& memory) const;
  /// "drive.bag, chunk at byte 4117"
  std::string where(std::uint32_t chunk) const;

 private:
  /// The chunk expanded, at least its first `least` bytes as far as it has them.
  std::shared_ptr<const Expanded> expanded(std::uint32_t chunk, std::uint64_t least) const;

  std::shared_ptr<const PartFile> file_;
  std::vector<Chunk> chunks_;
  mutable std::mutex mutex_;  ///< Guards what follows.
  mutable std::list<std::pair<std::uint32_t, std::shared_ptr<const Expanded>>> recent_;  ///< Newest first.
};

/// Reads records one after the other without a call to the system for each.
class RecordWindow {
 public:
  RecordWindow(const ChunkedFile& file, std::uint32_t chunk) : file_(file), chunk_(chunk) {}
  /// Bytes [offset, offset + n); fewer at the end. Valid until the next call.
  std::string_view at(std::uint64_t offset, std::size_t n);

 private:
  const ChunkedFile& file_;
  std::uint32_t chunk_;
  std::uint64_t begin_ = 0;
  std::string_view bytes_;
  MessageBytes memory_;
};

}  // namespace hp2
