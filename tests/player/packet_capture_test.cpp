// Packet captures written here: whole turns, lost, doubled and reordered packets, fragments, several sensors,
// files that are cut off, and Ouster's metadata.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "player/packets/ouster.hpp"
#include "player/packets/packet_decoder.hpp"
#include "player/scan_source.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::error_of;
using test::put;
using test::TemporaryFolder;

constexpr std::int64_t kStart_us = 1'700'002'800'000'000;  // a full hour: the sensor's clock begins at 0
constexpr double kRange_m = 20.0;

struct Datagram {
  std::int64_t received_us;
  std::string payload, address = "192.168.1.201";
  std::uint16_t port = 2368;
};

/// Packets of a Velodyne that turns at 10 Hz, clockwise, and sees a sphere of 20 m.
std::vector<Datagram> velodyne_packets(double first_deg, double turns, unsigned model = 0x22,
                                       double unit_m = 0.002, double block_us = 110.592) {
  std::vector<Datagram> packets;
  const auto n = static_cast<std::size_t>(turns * 1e5 / (12 * block_us));
  for (std::size_t p = 0; p < n; ++p) {
    std::string bytes;
    const double t_us = static_cast<double>(p) * 12 * block_us;
    for (std::size_t b = 0; b < 12; ++b) {
      const double azimuth =
          std::fmod(first_deg + (t_us + static_cast<double>(b) * block_us) * 360.0 / 1e5, 360.0);
      put<std::uint16_t>(bytes, 0xeeff);
      put<std::uint16_t>(bytes, static_cast<std::uint16_t>(std::lround(azimuth * 100.0) % 36000));
      for (std::size_t k = 0; k < 32; ++k) {
        put<std::uint16_t>(bytes, static_cast<std::uint16_t>(kRange_m / unit_m));
        put<std::uint8_t>(bytes, static_cast<std::uint8_t>(k));
      }
    }
    put<std::uint32_t>(bytes, static_cast<std::uint32_t>(std::lround(t_us)));
    put<std::uint8_t>(bytes, 0x37);
    put<std::uint8_t>(bytes, static_cast<std::uint8_t>(model));
    packets.push_back({kStart_us + std::lround(t_us) + 300, bytes});
  }
  return packets;
}

void big16(std::string& bytes, std::size_t v) {
  bytes += static_cast<char>(v >> 8);
  bytes += static_cast<char>(v & 0xff);
}

/// A pcap of Ethernet frames; datagrams longer than `most` bytes are sent in fragments, the last one first.
std::string pcap_of(const std::vector<Datagram>& datagrams, std::size_t most = 9000) {
  std::string file;
  put<std::uint32_t>(file, 0xa1b2c3d4);
  put<std::uint32_t>(file, 0x00040002);
  for (const std::uint32_t v : {0U, 0U, 262144U, 1U}) put(file, v);
  std::size_t number = 0;
  for (const Datagram& d : datagrams) {
    std::string udp;
    big16(udp, 2368), big16(udp, d.port), big16(udp, d.payload.size() + 8), big16(udp, 0);
    udp += d.payload;
    ++number;
    std::vector<std::size_t> offsets;
    for (std::size_t at = 0; at < udp.size(); at += most / 8 * 8) offsets.push_back(at);
    std::reverse(offsets.begin(), offsets.end());
    for (const std::size_t at : offsets) {
      const std::string part = udp.substr(at, most / 8 * 8);
      std::string frame(12, '\x02');
      frame += std::string("\x08\x00\x45\x00", 4);
      big16(frame, part.size() + 20), big16(frame, number);
      big16(frame, at / 8 + (at + part.size() < udp.size() ? 0x2000 : 0));
      frame += std::string("\x40\x11\x00\x00", 4);
      unsigned a = 0, b = 0, c = 0, e = 0;
      std::sscanf(d.address.c_str(), "%u.%u.%u.%u", &a, &b, &c, &e);
      for (const unsigned v : {a, b, c, e, 255U, 255U, 255U, 255U}) frame += static_cast<char>(v);
      frame += part;
      put(file, static_cast<std::uint32_t>(d.received_us / 1'000'000));
      put(file, static_cast<std::uint32_t>(d.received_us % 1'000'000));
      put(file, static_cast<std::uint32_t>(frame.size()));
      put(file, static_cast<std::uint32_t>(frame.size()));
      file += frame;
    }
  }
  return file;
}

std::unique_ptr<ScanSource> open_pcap(const TemporaryFolder& folder, const std::string& bytes,
                                      const SourceOptions& options = {}) {
  folder.write("drive.pcap", bytes);
  return open_source(folder.path() + "/drive.pcap", options);
}

std::string all_warnings(const ScanSource& source) {
  std::string all;
  for (const std::string& w : source.warnings()) all += w + "\n";
  return all;
}

void expect_equal(const Scan& a, const Scan& b) {
  test::expect_same_points(a, b);
  EXPECT_EQ(a.time, b.time);
  EXPECT_EQ(a.utime, b.utime);
}

TEST(PacketCapture, PartialTurnsAtBothEndsAreLeftOut) {
  const TemporaryFolder folder;
  const auto source = open_pcap(folder, pcap_of(velodyne_packets(90.0, 5.5)));
  EXPECT_EQ(source->info().format, "pcap");
  EXPECT_EQ(source->info().sensor, "vlp16");
  ASSERT_EQ(source->size(), 4U);
  EXPECT_EQ(all_warnings(*source), "");
  for (std::size_t i = 0; i < 4; ++i) {
    const Scan scan = source->read(i);
    EXPECT_NEAR(static_cast<double>(scan.utime - kStart_us), 75'000.0 + 1e5 * static_cast<double>(i), 200.0);
    EXPECT_NEAR(static_cast<double>(scan.duration_us), 1e5, 200.0);
    EXPECT_NEAR(static_cast<double>(scan.size()), 1e5 / 110.592 * 32, 64.0);
    ASSERT_EQ(scan.time.size(), scan.size());
    for (std::size_t k = 0; k < scan.size(); k += 97) {
      EXPECT_NEAR(std::hypot(scan.x[k], scan.y[k], scan.z[k]), kRange_m, 1e-3);
      double azimuth = std::atan2(-scan.y[k], scan.x[k]) * 180.0 / M_PI;  // clockwise from x
      if (azimuth < -1.0 || (azimuth < 0.0 && scan.time[k] > 0.5F))
        azimuth += 360.0;  // the last firings pass it
      EXPECT_NEAR(scan.time[k], azimuth / 360.0, 2e-3);
    }
  }
}

TEST(PacketCapture, DoubledAndReorderedPacketsMakeTheSameScans) {
  const TemporaryFolder folder, other;
  const auto packets = velodyne_packets(0.0, 3.5);
  auto mixed = packets;
  for (std::size_t i = 5; i + 8 < mixed.size(); i += 20) std::swap(mixed[i], mixed[i + 3]);
  for (std::size_t i = 0; i < mixed.size(); i += 11)
    mixed.insert(mixed.begin() + static_cast<std::ptrdiff_t>(i), mixed[i]);
  const auto good = open_pcap(folder, pcap_of(packets)),
             bad = open_pcap(other, pcap_of(mixed, 600));  // in fragments, too
  ASSERT_EQ(good->size(), bad->size());
  for (std::size_t i = 0; i < good->size(); ++i) expect_equal(good->read(i), bad->read(i));
  EXPECT_NE(all_warnings(*bad).find("came twice"), std::string::npos);
  EXPECT_NE(all_warnings(*bad).find("out of order"), std::string::npos);
}

TEST(PacketCapture, LostPacketsLeaveAHoleAndAreCounted) {
  const TemporaryFolder folder;
  auto packets = velodyne_packets(0.0, 6.5);
  packets.erase(packets.begin() + 100, packets.begin() + 103);  // a part of turn 1
  packets.erase(packets.begin() + 240,
                packets.begin() + 240 + static_cast<std::ptrdiff_t>(160));  // two turns
  const auto source = open_pcap(folder, pcap_of(packets));
  EXPECT_EQ(source->size(), 3U) << all_warnings(*source);
  EXPECT_NE(all_warnings(*source).find("163 packets are missing"), std::string::npos)
      << all_warnings(*source);
  EXPECT_LT(source->read(1).size(), source->read(0).size());
}

TEST(PacketCapture, OneImpossibleTimeIsOneLostPacket) {
  const TemporaryFolder folder;
  auto packets = velodyne_packets(0.0, 3.5);
  packets[100].payload[1203] = '\x5a';
  const auto source = open_pcap(folder, pcap_of(packets));
  EXPECT_EQ(source->size(), 3U);
  EXPECT_NE(all_warnings(*source).find("1 packets are damaged"), std::string::npos) << all_warnings(*source);
}

TEST(PacketCapture, SeveralSensorsAreNamedAndOneIsChosen) {
  const TemporaryFolder folder;
  auto packets = velodyne_packets(0.0, 3.5);
  for (Datagram d : velodyne_packets(45.0, 4.5, 0x28, 0.004, 55.296)) {
    d.address = "192.168.1.77";
    packets.push_back(d);
  }
  packets.push_back({kStart_us, std::string(554, 'x'), "192.168.1.201", 8308});
  std::stable_sort(packets.begin(), packets.end(),
                   [](const Datagram& a, const Datagram& b) { return a.received_us < b.received_us; });
  const std::string message = error_of([&] { open_pcap(folder, pcap_of(packets)); });
  EXPECT_NE(message.find("192.168.1.201:2368 (vlp16), 192.168.1.77:2368 (vlp32c)"), std::string::npos)
      << message;
  SourceOptions options;
  options.topic = "192.168.1.77";
  const auto source = open_pcap(folder, pcap_of(packets), options);
  EXPECT_EQ(source->info().sensor, "vlp32c");
  EXPECT_EQ(source->size(), 3U);
  const Scan scan = source->read(0);
  EXPECT_NEAR(std::hypot(scan.x[0], scan.y[0], scan.z[0]), kRange_m, 1e-3);
  options.topic = "10.0.0.1";
  EXPECT_NE(error_of([&] { open_pcap(folder, pcap_of(packets), options); }).find("192.168.1.201:2368"),
            std::string::npos);
}

TEST(PacketCapture, FileThatIsCutOffGivesTheScansBeforeTheCut) {
  const TemporaryFolder folder, other;
  const std::string bytes = pcap_of(velodyne_packets(0.0, 6.5));
  const auto whole = open_pcap(folder, bytes);
  for (const double share : {0.3, 0.55, 0.9}) {
    const auto cut = open_pcap(
        other, bytes.substr(0, static_cast<std::size_t>(share * static_cast<double>(bytes.size())) + 17));
    ASSERT_EQ(cut->size(), static_cast<std::size_t>(share * 6.5)) << share;
    EXPECT_NE(all_warnings(*cut).find("ends early"), std::string::npos);
    for (std::size_t i = 0; i < cut->size(); ++i) expect_equal(cut->read(i), whole->read(i));
  }
  for (const std::size_t size : {0U, 10U, 30U, 900U})
    EXPECT_NE(error_of([&] { open_pcap(other, bytes.substr(0, size)); }), "") << size;
}

TEST(PacketCapture, FiringsOfEachModelHaveTheirTimes) {
  struct Case {
    unsigned model;
    double unit_m, block_us, last_us;  // of the last laser of a firing sequence after the first one
  };
  for (const Case c : {Case{0x21, 0.002, 46.08, 31 * 1.152}, Case{0x28, 0.004, 55.296, 15 * 2.304},
                       Case{0x22, 0.002, 110.592, 55.296 + 15 * 2.304}}) {
    const auto packets = velodyne_packets(0.0, 2.5, c.model, c.unit_m, c.block_us);
    const auto sensor = recognise_sensor(packets[0].payload, {});
    ASSERT_TRUE(sensor);
    const auto decoder = sensor->make_decoder(true);
    std::vector<Turn> turns;
    for (std::size_t i = 0; i < packets.size(); ++i)
      decoder->take(packets[i].received_us, i, packets[i].payload, turns);
    decoder->finish(turns);
    ASSERT_EQ(turns.size(), 3U) << sensor->name();
    const Scan& scan = turns[1].scan;
    EXPECT_NEAR(scan.time[31] - scan.time[0], c.last_us / 1e5, 2e-5) << sensor->name();
  }
}

/// Metadata of a made-up Ouster of 16 beams.
std::string ouster_metadata(const std::string& more = "") {
  std::string angles;
  for (int i = 0; i < 16; ++i) angles += (i ? "," : "") + std::to_string(15 - 2 * i);
  return "{\"prod_line\": \"OS-1-16\", \"lidar_mode\": \"512x10\", \"lidar_origin_to_beam_origin_mm\": 10.0, "
         "\"beam_altitude_angles\": [" +
         angles +
         "], \"beam_azimuth_angles\": [0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0], "
         "\"lidar_to_sensor_transform\": [-1,0,0,0,0,-1,0,0,0,0,1,36,0,0,0,1]" +
         more + "}";
}

/// Legacy packets: `turns` turns of 512 columns from column `first` on.
std::vector<Datagram> ouster_packets(std::size_t first, std::size_t packets) {
  std::vector<Datagram> all;
  for (std::size_t p = 0; p < packets; ++p) {
    std::string bytes;
    for (std::size_t c = 0; c < 16; ++c) {
      const std::size_t column = first + p * 16 + c;
      put<std::uint64_t>(bytes, 5'000'000'000 + column * 195'312);
      put<std::uint16_t>(bytes, static_cast<std::uint16_t>(column % 512));
      put<std::uint16_t>(bytes, static_cast<std::uint16_t>(7 + column / 512));
      put<std::uint32_t>(bytes, 0);
      for (std::size_t k = 0; k < 16; ++k) {
        put<std::uint32_t>(bytes, 20'000);
        put<std::uint32_t>(bytes, 0x00330022);
        put<std::uint32_t>(bytes, 0x44);
      }
      put<std::uint32_t>(bytes, 0xffffffff);
    }
    all.push_back({kStart_us + static_cast<std::int64_t>(p) * 3125, bytes, "10.0.0.5", 7502});
  }
  return all;
}

TEST(PacketCapture, OusterWithItsMetadataBesideIt) {
  const TemporaryFolder folder;
  const std::string bytes = pcap_of(ouster_packets(256, 32 * 3), 1480);
  EXPECT_NE(error_of([&] { open_pcap(folder, bytes); }).find("--metadata"), std::string::npos);
  folder.write("drive.json", ouster_metadata());
  const auto source = open_pcap(folder, bytes);
  ASSERT_EQ(source->size(), 2U);
  const Scan scan = source->read(0);
  ASSERT_EQ(scan.size(), 512U * 16U);
  EXPECT_NEAR(static_cast<double>(scan.duration_us), 1e5, 10.0);
  EXPECT_NEAR(static_cast<double>(scan.utime - kStart_us), 50'000.0,
              100.0);  // the receiver's clock: the sensor's began at 5 s
  // Column 0 looks along x of the LiDAR's frame, which is turned by half a turn.
  const double up = 15.0 * M_PI / 180.0, r = 20.0 - 0.010;
  EXPECT_NEAR(scan.x[0], -(r * std::cos(up) + 0.010), 1e-4);
  EXPECT_NEAR(scan.y[0], 0.0, 1e-4);
  EXPECT_NEAR(scan.z[0], r * std::sin(up) + 0.036, 1e-4);
  EXPECT_FLOAT_EQ(scan.intensity[0], 51.0F);  // the signal
}

TEST(OusterMetadata, MalformedOnesAreRefusedWithTheReason) {
  const auto refusal = [](const std::string& text) {
    return error_of([&] { parse_ouster_metadata(text, "m.json"); });
  };
  EXPECT_EQ(refusal(ouster_metadata()), "");
  const std::pair<std::string, std::string> cases[] = {
      {"", "is no JSON"},
      {"[1]", "no JSON object"},
      {"{}", "lacks 'beam_altitude_angles'"},
      {ouster_metadata().substr(0, 100), "is no JSON"},
      {ouster_metadata(", \"data_format\": {\"pixels_per_column\": 32}"), "16 and 16 beams for 32 pixels"},
      {ouster_metadata(", \"data_format\": {\"columns_per_frame\": 0}"), "columns_per_frame"},
      {ouster_metadata(", \"data_format\": {\"column_window\": [0, 512]}"), "column_window"},
      {ouster_metadata(", \"data_format\": {\"udp_profile_lidar\": \"RNG99\"}"), "RNG99"},
      {ouster_metadata(", \"data_format\": {\"udp_profile_lidar\": 3}"), "udp_profile_lidar"},
      {"{\"lidar_mode\": \"1024x10\", \"beam_altitude_angles\": [1, \"a\"], \"beam_azimuth_angles\": [1, 2]}",
       "no number"},
      {"{\"beam_altitude_angles\": [1], \"beam_azimuth_angles\": [1]}", "lidar_mode"}};
  for (const auto& [text, reason] : cases)
    EXPECT_NE(refusal(text).find(reason), std::string::npos) << refusal(text);
}

}  // namespace
}  // namespace hp2
