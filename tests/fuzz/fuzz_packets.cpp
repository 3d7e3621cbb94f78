// Bytes through the packet decoders and the reader of captures: read, or refused with an Error; nothing else.
// The first byte chooses: a capture, Ouster's metadata, or packets of one sensor whose marks are set.
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>
#include <sys/mman.h>
#include <unistd.h>

#include "common/error.hpp"
#include "player/packets/ouster.hpp"
#include "player/packets/packet_decoder.hpp"
#include "player/readers/drive.hpp"

namespace {

void read_capture(std::string_view bytes) {
  static const int file = ::memfd_create("fuzzed", 0);
  static const std::string path = "/proc/self/fd/" + std::to_string(file);
  if (::ftruncate(file, 0) != 0 ||
      ::pwrite(file, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    std::abort();
  const hp2::Drive drive = hp2::open_packet_capture(path, {});
  for (std::size_t i = 0; i < drive.scans.size() && i < 4; ++i) {
    hp2::Scan scan;
    drive.decode(drive.scans[i], scan);
    if (scan.y.size() != scan.size() || scan.time.size() != scan.size()) std::abort();
  }
}

/// Packets of `size` bytes out of the input, repeated to their length; `mark` makes them a sensor's.
template <typename Mark>
void decode_packets(std::string_view bytes, std::size_t size, const Mark& mark) {
  static const hp2::PacketSensorOptions options = [] {
    hp2::PacketSensorOptions o;
    o.metadata =
        "{\"lidar_mode\": \"512x10\", \"beam_altitude_angles\": [2, 1], \"beam_azimuth_angles\": [0, 0]}";
    return o;
  }();
  std::unique_ptr<hp2::PacketDecoder> decoder;
  std::vector<hp2::Turn> turns;
  for (std::size_t p = 0; p < 24 && !bytes.empty(); ++p) {
    std::string packet;
    while (packet.size() < size) packet += bytes.substr(p % bytes.size(), size - packet.size());
    packet.resize(size);
    mark(packet);
    if (!decoder) {
      const auto sensor = hp2::recognise_sensor(packet, options);
      if (!sensor) continue;
      decoder = sensor->make_decoder(true);
    }
    decoder->take(static_cast<std::int64_t>(p), p, packet, turns);
  }
  if (decoder) decoder->finish(turns);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data + 1), size - 1);
  const auto velodyne = [](char model) {
    return [model](std::string& packet) {
      for (std::size_t b = 0; b < 12; ++b) {
        packet[100 * b] = '\xff';
        packet[100 * b + 1] = model == '\xa1' ? static_cast<char>(0xee - 0x11 * (b % 4)) : '\xee';
        packet[100 * b + 3] = static_cast<char>(packet[100 * b + 3] & 0x7f);
      }
      packet[1203] = '\0';
      packet[1205] = model;
    };
  };
  const auto hesai = [](std::size_t counts_at, char channels, char blocks, std::size_t mode_at) {
    return [=](std::string& packet) {
      packet[0] = '\xee', packet[1] = '\xff';
      packet[counts_at] = channels, packet[counts_at + 1] = blocks;
      packet[mode_at] = static_cast<char>(0x37 + (packet[mode_at] & 3));
    };
  };
  try {
    switch (data[0] % 8) {
      case 0:
        read_capture(bytes);
        break;
      case 1:
        hp2::parse_ouster_metadata(std::string(bytes), "fuzzed");
        break;
      case 2:
        decode_packets(bytes, 1206, velodyne('\x22'));
        break;
      case 3:
        decode_packets(bytes, 1206, velodyne('\x28'));
        break;
      case 4:
        decode_packets(bytes, 1206, velodyne('\xa1'));
        break;
      case 5:
        decode_packets(bytes, 1080, hesai(6, 32, 8, 12 + 8 * 130 + 10));
        break;
      case 6:
        decode_packets(bytes, 1194, hesai(2, 64, 6, 8 + 6 * 194 + 14));
        break;
      default:
        decode_packets(bytes, 16 * 44, [](std::string& packet) {
          for (std::size_t c = 0; c < 16; c += 2) std::memset(packet.data() + 44 * c + 40, 0xff, 4);
        });
    }
  } catch (const hp2::Error&) {
  }
  return 0;
}
