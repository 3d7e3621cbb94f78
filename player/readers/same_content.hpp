// Whether two scans are copies of one another, without reading all of them.
#pragma once
#include <algorithm>
#include <cstdint>

#include "player/readers/file_io.hpp"

namespace hp2 {

/// Bytes of a file from `at` on.
struct FilePart {
  const PartFile& file;
  std::uint64_t at = 0, size = 0;
};

/// Whether both are as long and agree in five stretches. Two sweeps of a sensor never do: its noise sees to
/// that.
inline bool same_content(const FilePart& a, const FilePart& b) {
  constexpr std::uint64_t kStretch = 4096;
  if (a.size != b.size) return false;
  for (std::uint64_t i = 0; i < 5; ++i) {
    const std::uint64_t last = a.size - std::min(a.size, kStretch);
    const std::uint64_t offset = last * i / 4;
    const auto n = static_cast<std::size_t>(std::min(kStretch, a.size - offset));
    if (a.file.read(a.at + offset, n) != b.file.read(b.at + offset, n)) return false;
  }
  return true;
}
inline bool same_content(const PartFile& a, const PartFile& b) {
  return same_content(FilePart{a, 0, a.size()}, FilePart{b, 0, b.size()});
}

}  // namespace hp2
