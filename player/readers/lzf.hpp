// LZF, the compression inside "binary_compressed" PCD files.
#pragma once
#include <cstddef>
#include <string_view>

namespace hp2 {

/// Expands LZF data into out[0 .. size).
/// @return false unless the data is sound and expands to exactly `size` bytes
bool lzf_expand(std::string_view data, char* out, std::size_t size);

}  // namespace hp2
