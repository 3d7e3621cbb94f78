#include "player/readers/lzf.hpp"

#include <cstring>

namespace hp2 {

// The format: a control byte c < 32 is followed by c + 1 literal bytes; otherwise c >> 5 is a length (7: one
// more byte adds to it) plus 2, and the low 5 bits with the next byte a distance back, less 1.
bool lzf_expand(std::string_view data, char* out, std::size_t size) {
  std::size_t in = 0;
  std::size_t done = 0;
  while (in < data.size()) {
    const unsigned control = static_cast<unsigned char>(data[in++]);
    if (control < 32) {
      const std::size_t n = control + 1;
      if (n > data.size() - in || n > size - done) return false;
      std::memcpy(out + done, data.data() + in, n);
      in += n;
      done += n;
      continue;
    }
    std::size_t n = control >> 5;
    if (n == 7) {
      if (in >= data.size()) return false;
      n += static_cast<unsigned char>(data[in++]);
    }
    n += 2;
    if (in >= data.size()) return false;
    const std::size_t back = ((control & 31U) << 8) + static_cast<unsigned char>(data[in++]) + 1;
    if (back > done || n > size - done) return false;
    for (std::size_t i = 0; i < n; ++i, ++done)
      out[done] = out[done - back];  // may overlap itself: byte by byte
  }
  return done == size;
}

}  // namespace hp2
