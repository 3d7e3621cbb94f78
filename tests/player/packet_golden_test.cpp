// Packets of real sensors against the points and fields that the makers' programs decode from them
// (shared/data/formats; the tests skip without it).
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <unordered_map>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <sqlite3.h>

#include "player/packets/capture.hpp"
#include "player/packets/ouster.hpp"
#include "player/packets/packet_decoder.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/point_file.hpp"
#include "player/scan_source.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

const std::string kFormats = std::string(HP2_SHARED_DIR) + "/data/formats";
const std::string kOuster = kFormats + "/ouster-sdk/tests/pcaps/";

/// The packets in the messages of a bag: stamp, data (of a fixed length), and for Hesai the length in use.
std::vector<std::string> packets_of_bag(const std::string& path, std::size_t bytes, bool with_size) {
  std::vector<std::string> packets;
  sqlite3* db = nullptr;
  sqlite3_stmt* rows = nullptr;
  if (sqlite3_open_v2(path.c_str(), &db, SQLITE_OPEN_READONLY, nullptr) != SQLITE_OK) return packets;
  sqlite3_prepare_v2(db, "select data from messages order by timestamp", -1, &rows, nullptr);
  while (sqlite3_step(rows) == SQLITE_ROW) {
    const std::string message(static_cast<const char*>(sqlite3_column_blob(rows, 0)),
                              static_cast<std::size_t>(sqlite3_column_bytes(rows, 0)));
    std::size_t at = 4;  // after the encapsulation's header, from which on numbers are aligned
    const auto number = [&] {
      at = (at + 3) / 4 * 4;
      std::uint32_t value = 0;
      std::memcpy(&value, message.data() + at, 4);
      at += 4;
      return value;
    };
    number(), number();
    at += number();
    for (std::uint32_t n = number(); n > 0; --n) {
      number(), number();
      std::string data = message.substr(at, bytes);
      at += bytes;
      if (with_size) data.resize(std::min<std::size_t>(number(), bytes));
      packets.push_back(data);
    }
  }
  sqlite3_finalize(rows);
  sqlite3_close(db);
  return packets;
}

/// Share of `golden` that has a point of `found` within 2 mm.
double share_within_2_mm(const Scan& golden, const Scan& found) {
  constexpr double kCell_m = 0.004;
  const auto cell = [](float v) { return static_cast<std::int64_t>(std::floor(v / kCell_m)); };
  const auto key = [](std::int64_t x, std::int64_t y, std::int64_t z) {
    return (x * 73856093) ^ (y * 19349663) ^ (z * 83492791);
  };
  std::unordered_multimap<std::int64_t, std::size_t> grid;
  for (std::size_t i = 0; i < found.size(); ++i)
    grid.emplace(key(cell(found.x[i]), cell(found.y[i]), cell(found.z[i])), i);
  std::size_t good = 0;
  for (std::size_t i = 0; i < golden.size(); ++i) {
    bool near = false;
    for (int d = 0; d < 27 && !near; ++d) {
      const auto range = grid.equal_range(key(
          cell(golden.x[i]) + d % 3 - 1, cell(golden.y[i]) + d / 3 % 3 - 1, cell(golden.z[i]) + d / 9 - 1));
      for (auto it = range.first; it != range.second && !near; ++it) {
        const std::size_t k = it->second;
        near =
            std::hypot(golden.x[i] - found.x[k], golden.y[i] - found.y[k], golden.z[i] - found.z[k]) <= 0.002;
      }
    }
    good += near ? 1 : 0;
  }
  return static_cast<double>(good) / static_cast<double>(golden.size());
}

struct Golden {
  std::string bag, points, sensor;
  std::size_t bytes;
  bool with_size;
};

class PacketGolden : public ::testing::TestWithParam<Golden> {};

TEST_P(PacketGolden, PointsAreTheMakersPoints) {
  const Golden& g = GetParam();
  const std::string folder = kFormats + "/nebula/";
  if (!is_file(folder + g.points)) GTEST_SKIP() << "no " << folder;
  const std::vector<std::string> packets = packets_of_bag(folder + g.bag, g.bytes, g.with_size);
  ASSERT_FALSE(packets.empty());
  const auto sensor = recognise_sensor(packets.front(), {});
  ASSERT_TRUE(sensor);
  EXPECT_EQ(sensor->name(), g.sensor);
  const auto decoder = sensor->make_decoder(true);
  std::vector<Turn> turns;
  for (std::size_t i = 0; i < packets.size(); ++i)
    decoder->take(static_cast<std::int64_t>(i) * 1000, i, packets[i], turns);
  decoder->finish(turns);
  EXPECT_EQ(decoder->counts().refused, 0U);
  EXPECT_EQ(decoder->counts().doubled, 0U);
  Scan all;
  std::size_t whole = 0;
  for (const Turn& turn : turns) {
    if (turn.whole) {
      ++whole;
      EXPECT_NEAR(static_cast<double>(turn.duration_us), 1e5, 2e3);
      EXPECT_NEAR(turn.covered_deg, g.sensor == "vlp32c" ? 178.5 : 360.0,
                  1.0);  // that one looks forward only
      EXPECT_LT(*std::min_element(turn.scan.time.begin(), turn.scan.time.end()), 0.01F);
      EXPECT_GT(*std::max_element(turn.scan.time.begin(), turn.scan.time.end()), 0.99F);
    }
    all.x.insert(all.x.end(), turn.scan.x.begin(), turn.scan.x.end());
    all.y.insert(all.y.end(), turn.scan.y.begin(), turn.scan.y.end());
    all.z.insert(all.z.end(), turn.scan.z.begin(), turn.scan.z.end());
  }
  EXPECT_GE(whole, 2U);
  if (g.sensor.rfind("hesai", 0) == 0) {  // the date in its packets
    EXPECT_GT(turns.front().start_ns, 1'400'000'000'000'000'000) << "before 2014";
    EXPECT_LT(turns.front().start_ns, 1'800'000'000'000'000'000) << "after 2027";
  }
  PointFile golden;
  read_point_file(folder + g.points, golden);
  EXPECT_GE(share_within_2_mm(golden.scan, all), 0.999);
}

INSTANTIATE_TEST_SUITE_P(
    Nebula, PacketGolden,
    ::testing::Values(Golden{"hesai/40p/1673400149412331409/1673400149412331409_0.db3",
                             "hesai/40p/1673400149711850138.pcd", "hesai 40p", 1500, true},
                      Golden{"hesai/64/1673403880599376836/1673403880599376836_0.db3",
                             "hesai/64/1673403880898440686.pcd", "hesai 64", 1500, true},
                      Golden{"hesai/qt64/1673401195788312575/1673401195788312575_0.db3",
                             "hesai/qt64/1673401196087570870.pcd", "hesai qt64", 1500, true},
                      Golden{"hesai/xt16/1732848127890747768/1732848127890747768_0.db3",
                             "hesai/xt16/1732848128093928016.pcd", "hesai xt16", 1500, true},
                      Golden{"hesai/xt32/1673400677802009732/1673400677802009732_0.db3",
                             "hesai/xt32/1673400678101968885.pcd", "hesai xt32", 1500, true},
                      Golden{"velodyne/vlp16/1673400471837873222/1673400471837873222_0.db3",
                             "velodyne/vlp16/1673400472138016708.pcd", "vlp16", 1206, false},
                      Golden{"velodyne/vlp32/1713492677464078412/1713492677464078412_0.db3",
                             "velodyne/vlp32/1713492677464078412.pcd", "vlp32c", 1206, false}),
    [](const ::testing::TestParamInfo<Golden>& golden) {
      std::string name = golden.param.sensor;
      for (char& c : name) c = c == ' ' ? '_' : c;
      return name;
    });

/// MD5 of bytes, by the system's program.
std::string md5_of(const std::string& bytes) {
  const test::TemporaryFolder folder;
  folder.write("bytes", bytes);
  std::FILE* pipe = ::popen(("md5sum < " + folder.path() + "/bytes").c_str(), "r");
  char digest[33] = "";
  const bool read = std::fscanf(pipe, "%32s", digest) == 1;
  ::pclose(pipe);
  return read ? digest : "";
}

class OusterDigest : public ::testing::TestWithParam<const char*> {};

// Ouster's digests: all packets' numbers of a field one after the other, by rows of pixels.
TEST_P(OusterDigest, FieldsOfAllPacketsHaveOustersDigests) {
  const std::string base = kOuster + GetParam();
  if (!is_file(base + ".pcap")) GTEST_SKIP() << "no " << kOuster;
  const OusterLayout layout(parse_ouster_metadata(read_text(base + ".json"), base));
  const auto& info = layout.info();
  const auto digests = nlohmann::json::parse(read_text(base + "_digest.json")).at("packet_hash");
  std::map<std::string, std::string> bytes;
  Capture(base + ".pcap").read(0, UINT64_MAX, [&](const Datagram& d) {
    if (d.payload.size() != layout.packet_bytes()) return true;
    for (const OusterField& field : layout.fields())
      for (std::size_t p = 0; p < info.pixels_per_column; ++p)
        for (std::size_t c = 0; c < info.columns_per_packet; ++c) {
          const auto value = layout.value(d.payload, c, p, field);
          const std::size_t width = field.bits + field.upshift;
          bytes[field.name].append(reinterpret_cast<const char*>(&value), width <= 8    ? 1
                                                                          : width <= 16 ? 2
                                                                                        : 4);
        }
    for (std::size_t c = 0; c < info.columns_per_packet; ++c) {
      test::put(bytes["TIMESTAMP"], layout.timestamp_ns(d.payload, c));
      test::put(bytes["MEASUREMENT_ID"], static_cast<std::uint16_t>(layout.measurement_id(d.payload, c)));
      test::put(bytes["STATUS"], layout.status(d.payload, c));
    }
    return true;
  });
  ASSERT_FALSE(bytes.empty());
  for (const auto& [name, content] : bytes)
    if (digests.contains(name)) {
      EXPECT_EQ(md5_of(content), digests.at(name).get<std::string>()) << name;
    }
  for (const char* must : {"RANGE", "REFLECTIVITY", "NEAR_IR", "TIMESTAMP", "MEASUREMENT_ID"})
    EXPECT_TRUE(digests.contains(must)) << must;
}

INSTANTIATE_TEST_SUITE_P(Ouster, OusterDigest,
                         ::testing::Values("OS-0-128-U1_v2.3.0_1024x10", "OS-0-32-U1_v2.2.0_1024x10",
                                           "OS-1-32-G_v2.1.1_1024x10", "OS-2-128-U1_v2.3.0_1024x10",
                                           "OS-2-32-U0_v2.0.0_1024x10"));

TEST(OusterCaptures, WholeFramesOpenAndTheRestIsRefusedWithTheReason) {
  if (!is_folder(kOuster)) GTEST_SKIP() << "no " << kOuster;
  EXPECT_EQ(open_source(kOuster + "OS-1-128_v2.3.0_1024x10_lb_n3.pcap")->size(), 3U);
  EXPECT_EQ(open_source(kOuster + "windowed_frame1.pcap")->size(), 1U);
  EXPECT_EQ(open_source(kOuster + "windowed_frame2.pcap")->size(), 1U);
  SourceOptions options;
  options.metadata = kOuster + "OS-1-64_sensor_config_reduced.json";
  EXPECT_EQ(open_source(kOuster + "OS-1-64_1024x10_fw20.pcap", options)->size(), 1U);
  const auto refusal = [](const std::string& name) {
    return test::error_of([&] { open_source(kOuster + name); });
  };
  EXPECT_NE(refusal("OS-1-64_1024x10_fw20.pcap").find("--metadata"), std::string::npos);
  EXPECT_NE(refusal("same_ports.pcap").find("169.254.92.158:7502 (ouster OS-0-128)"), std::string::npos);
  EXPECT_NE(refusal("empty_pcap.pcap").find("no UDP datagrams"), std::string::npos);
  EXPECT_NE(refusal("imu_zm_no_lidar.pcap").find("452 bytes"), std::string::npos);
}

TEST(VelodyneCaptures, Hdl32eOpensWithTwoTurns) {
  const std::string path = kFormats + "/mrpt/sample_velodyne_hdl32.pcap";
  if (!is_file(path)) GTEST_SKIP() << "no " << path;
  const auto source = open_source(path);
  ASSERT_EQ(source->size(), 2U);
  EXPECT_EQ(source->info().sensor, "hdl32e");
  for (std::size_t i = 0; i < 2; ++i) {
    const Scan scan = source->read(i);
    EXPECT_NEAR(static_cast<double>(scan.duration_us), 110'600.0, 500.0);  // 9 Hz
    EXPECT_GT(scan.size(), 20'000U);
    EXPECT_EQ(scan.time.size(), scan.size());
  }
}

}  // namespace
}  // namespace hp2
