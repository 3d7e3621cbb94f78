// Bytes from the network through every decoder and every check. The first byte chooses the type; the type's
// fingerprint is put in front of the rest, or else nearly every input would be refused at once.
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "common/transport/convert.hpp"

namespace {

template <class T>
std::vector<std::uint8_t> with_fingerprint(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> bytes(8 + size);
  const auto hash = static_cast<std::uint64_t>(T::getHash());
  for (std::size_t i = 0; i < 8; ++i) bytes[i] = static_cast<std::uint8_t>(hash >> (56 - 8 * i));
  std::copy(data, data + size, bytes.begin() + 8);
  return bytes;
}

// What is accepted is encoded to the bytes that it came from.
template <class T>
void decode(const std::uint8_t* data, std::size_t size) {
  const auto bytes = with_fingerprint<T>(data, size);
  T message;
  if (hp2::safe_decode(bytes.data(), bytes.size(), message) &&
      hp2::encode_message(message).size() != bytes.size()) {
    std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::uint8_t type = data[0];
  ++data;
  --size;
  switch (type % 17) {
    case 0: {
      decode<hp2::chunk_t>(data, size);
      const auto bytes = with_fingerprint<hp2::chunk_t>(data, size);
      const auto piece = hp2::view_chunk(bytes.data(), bytes.size());
      if (piece && piece->data + piece->size != bytes.data() + bytes.size()) std::abort();
      break;
    }
    case 1:
      decode<hp2::closure_t>(data, size);
      break;
    case 2:
      decode<hp2::control_t>(data, size);
      break;
    case 3:
      decode<hp2::correction_t>(data, size);
      break;
    case 4:
      decode<hp2::fetch_t>(data, size);
      break;
    case 5:
      decode<hp2::graph_t>(data, size);
      break;
    case 6:
      decode<hp2::odometry_t>(data, size);
      break;
    case 7:
      decode<hp2::offer_t>(data, size);
      break;
    case 8:
      decode<hp2::resume_t>(data, size);
      break;
    case 9:
      decode<hp2::scan_t>(data, size);
      break;
    case 10:
      decode<hp2::status_t>(data, size);
      break;
    case 11:
      decode<hp2::submap_t>(data, size);
      break;
    case 12:
      decode<hp2::trajectory_t>(data, size);
      break;
    case 13: {
      const auto bytes = with_fingerprint<hp2::scan_t>(data, size);
      const auto scan = hp2::decode_scan(bytes.data(), bytes.size());
      if (scan && (scan->y.size() != scan->size() || scan->z.size() != scan->size())) std::abort();
      if (scan && hp2::encode_scan(*scan).size() != bytes.size()) std::abort();
      break;
    }
    case 14: {
      const auto bytes = with_fingerprint<hp2::submap_t>(data, size);
      const auto package = hp2::decode_submap(bytes.data(), bytes.size(), 0);
      if (package && package->submap.points.size() != package->submap.scan_indices.size()) std::abort();
      break;
    }
    case 15: {
      const auto bytes = with_fingerprint<hp2::graph_t>(data, size);
      hp2::decode_graph(bytes.data(), bytes.size(), 0);
      break;
    }
    default: {
      const auto bytes = with_fingerprint<hp2::trajectory_t>(data, size);
      hp2::decode_trajectory(bytes.data(), bytes.size(), 0);
      break;
    }
  }
  return 0;
}
