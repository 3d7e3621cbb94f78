// Compressed blocks and files of recordings: zstd, lz4 (frames) and bz2.
#pragma once
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

#include "player/readers/file_io.hpp"

namespace hp2 {

enum class Compression { kNone, kZstd, kLz4, kBz2, kUnknown };

/// The compression of this name ("", "none", "zstd", "lz4", "bz2").
Compression compression_of_name(std::string_view name);

/// The compression that bytes begin with, by their magic number; kNone if it is none of these.
Compression compression_of_bytes(std::string_view bytes);

/// Result of expanding a compressed block.
struct Expanded {
  std::string bytes;
  bool complete =
      false;  ///< The block's end was reached; otherwise it is damaged, cut off, or `most` ended it.
};

/// Expands a block. Memory grows with the actual output, whatever a header claims.
/// @param most  stop after so many bytes
/// @param reuse memory to expand into
/// @throws Error if the library does not start
Expanded expand(Compression compression, std::string_view packed, std::size_t most, std::string reuse = {});

/// A recording's file that may be compressed as a whole (`.db3.zstd`, `.mcap.lz4`, `.bag.bz2`).
struct PlainFile {
  std::shared_ptr<const PartFile> file;  ///< The plain bytes: the file itself, or a temporary one.
  std::string path;     ///< Of the plain bytes; a temporary file is deleted with this object.
  std::string warning;  ///< Where the compressed file is damaged or ends early.
  std::shared_ptr<const void> temporary;  ///< Deletes the temporary file; null if there is none.
};

/// Opens `path`, expanding it into a temporary file (in TMPDIR, else /tmp) if it is compressed.
/// @throws Error if it cannot be read, or the temporary file cannot be written
PlainFile open_plain(const std::string& path);

}  // namespace hp2
