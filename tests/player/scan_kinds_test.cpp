// Single-file kinds of scans: layouts of .bin records recognised or refused, text, NumPy, LAS, gzip, names
// that are times, fields' names, units.
#include <cmath>
#include <libdeflate.h>

#include <gtest/gtest.h>

#include "player/readers/bin_layout.hpp"
#include "player/readers/layout.hpp"
#include "player/readers/point_folder.hpp"
#include "player/scan_source.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::error_of;
using test::put;
using test::TemporaryFolder;

/// A hall of 30 x 12 x 5 m seen from inside, as a sensor of 16 rings measures it, ring by ring or column by
/// column.
Scan hall(bool by_column, std::size_t columns = 600) {
  Scan scan;
  for (std::size_t i = 0; i < 16 * columns; ++i) {
    const std::size_t ring = by_column ? i % 16 : i / columns, column = by_column ? i / 16 : i % columns;
    const double azimuth = 2.0 * M_PI * static_cast<double>(column) / static_cast<double>(columns);
    const double up = (-15.0 + 2.0 * static_cast<double>(ring)) * M_PI / 180.0;
    const double d[] = {std::cos(up) * std::cos(azimuth), -std::cos(up) * std::sin(azimuth), std::sin(up)};
    const double low[] = {-12.0, -5.0, -1.5}, high[] = {18.0, 7.0, 3.5};
    double r = 1e9;
    for (std::size_t k = 0; k < 3; ++k)
      if (d[k] != 0.0) r = std::min(r, (d[k] > 0.0 ? high[k] : low[k]) / d[k]);
    scan.x.push_back(static_cast<float>(r * d[0]));
    scan.y.push_back(static_cast<float>(r * d[1]));
    scan.z.push_back(static_cast<float>(r * d[2]));
    scan.intensity.push_back(static_cast<float>((i * 7919) % 256));
    scan.time.push_back(static_cast<float>(0.1 * static_cast<double>(column) / static_cast<double>(columns)));
  }
  return scan;
}

/// The scan's bytes with a layout's records.
template <typename T>
std::string records(const Scan& s, const std::string& letters) {
  std::string bytes;
  for (std::size_t i = 0; i < s.size(); ++i)
    for (const char c : letters) {
      if (c == 'x') put(bytes, static_cast<T>(s.x[i]));
      if (c == 'y') put(bytes, static_cast<T>(s.y[i]));
      if (c == 'z') put(bytes, static_cast<T>(s.z[i]));
      if (c == 'i') put(bytes, static_cast<T>(s.intensity[i]));
      if (c == 'r') put(bytes, static_cast<T>(i % 16));
      if (c == 't') put(bytes, static_cast<T>(s.time[i]));
    }
  return bytes;
}

std::string nclt_records(const Scan& s) {
  std::string bytes;
  for (std::size_t i = 0; i < s.size(); ++i) {
    for (const float v : {s.x[i], -s.y[i], -s.z[i]})
      put(bytes, static_cast<std::uint16_t>(std::lround((v + 100.0F) / 0.005F)));
    put(bytes, static_cast<std::uint8_t>(s.intensity[i]));
    put(bytes, static_cast<std::uint8_t>(i % 16));
  }
  return bytes;
}

void expect_near(const Scan& a, const Scan& b, float tolerance) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); i += 13) {
    EXPECT_NEAR(a.x[i], b.x[i], tolerance);
    EXPECT_NEAR(a.y[i], b.y[i], tolerance);
    EXPECT_NEAR(a.z[i], b.z[i], tolerance);
  }
}

TEST(BinLayout, EachIsRecognisedInEveryOrderOfThePoints) {
  for (const bool by_column : {false, true}) {
    const Scan scan = hall(by_column);
    const std::pair<std::string, std::string> cases[] = {{"xyzi", records<float>(scan, "xyzi")},
                                                         {"xyz", records<float>(scan, "xyz")},
                                                         {"xyzir", records<float>(scan, "xyzir")},
                                                         {"xyzit", records<float>(scan, "xyzit")},
                                                         {"xyzirt", records<float>(scan, "xyzirt")},
                                                         {"xyz-double", records<double>(scan, "xyz")},
                                                         {"xyzi-double", records<double>(scan, "xyzi")},
                                                         {"xyzir-double", records<double>(scan, "xyzir")},
                                                         {"nclt", nclt_records(scan)}};
    for (const auto& [name, bytes] : cases) {
      BinLayoutChoice choice;
      EXPECT_EQ(error_of([&] {
                  choice = choose_bin_layout({bytes, bytes}, "here");
                }),
                "")
          << name << by_column;
      ASSERT_TRUE(choice.layout) << name;
      EXPECT_EQ(choice.layout->name, name) << by_column;
      EXPECT_EQ(choice.note.empty(), name == "xyzi");
      PointFile file;
      parse_bin(bytes, "here", *choice.layout, file);
      expect_near(file.scan, scan, name == "nclt" ? 0.003F : 1e-6F);
      if (name != "xyz" && name != "xyz-double") {
        EXPECT_EQ(file.scan.intensity, scan.intensity);
      }
    }
  }
}

TEST(BinLayout, WhatIsNoScanIsRefusedWithWhatWasFound) {
  std::string noise;
  std::uint32_t state = 1;
  for (int i = 0; i < 24'000; ++i) put(noise, state = state * 1664525U + 1013904223U);
  const std::string message = error_of([&] { choose_bin_layout({noise}, "folder"); });
  EXPECT_NE(message.find("96000 bytes"), std::string::npos) << message;
  EXPECT_NE(message.find("--bin-layout"), std::string::npos);
  EXPECT_NE(
      error_of([&] { choose_bin_layout({noise.substr(0, 9001)}, "folder"); }).find("No known record fits"),
      std::string::npos);
}

TEST(BinLayout, DriveOfFiveFloatsOpensAndSaysSo) {
  const TemporaryFolder folder;
  const Scan scan = hall(false);
  for (int i = 0; i < 3; ++i)
    folder.write("n015__LIDAR_TOP__153188453944" + std::to_string(8719 + 1000 * i) + ".pcd.bin",
                 records<float>(scan, "xyzir"));
  const auto source = open_source(folder.path());
  expect_near(source->read(1), scan, 0.0F);
  ASSERT_FALSE(source->warnings().empty());
  EXPECT_NE(source->warnings().front().find("--bin-layout xyzir"), std::string::npos);
  SourceOptions options;
  options.bin_layout = "xyz";
  EXPECT_NE(open_source(folder.path(), options)->read(0).size(), scan.size());
  options.bin_layout = "xyzw";
  EXPECT_NE(error_of([&] { open_source(folder.path(), options); }).find("xyzirt"), std::string::npos);
}

TEST(ScanKinds, TextWithAndWithoutNames) {
  PointFile file;
  parse_text_points("1 2 3\n4 5 6\n", "a.xyz", file);
  EXPECT_EQ(file.scan.z, (std::vector<float>{3, 6}));
  EXPECT_TRUE(file.scan.intensity.empty());
  parse_text_points("# made by hand\n2\n1,2,3,0.5,0.01\r\n4,5,6,0.25,0.02\r\n", "a.csv", file);
  EXPECT_EQ(file.scan.intensity, (std::vector<float>{0.5F, 0.25F}));
  EXPECT_EQ(file.raw_time, (std::vector<double>{0.01, 0.02}));
  parse_text_points("Timestamp,X,Y,Z,reflectivity\n7,1,2,3,9\n8,4,5,6,9\n", "a.csv", file);
  EXPECT_EQ(file.scan.x, (std::vector<float>{1, 4}));
  EXPECT_EQ(file.raw_time, (std::vector<double>{7, 8}));
  EXPECT_NE(error_of([&] { parse_text_points("1 2 3\n4 5", "a.xyz", file); }).find("line 2"),
            std::string::npos);
  EXPECT_NE(error_of([&] { parse_text_points("1 2\n", "a.xyz", file); }).find("line 1"), std::string::npos);
}

std::string npy(const std::string& header, const std::string& data) {
  std::string bytes("\x93NUMPY\x01\x00", 8);
  put(bytes, static_cast<std::uint16_t>(header.size()));
  return bytes + header + data;
}

TEST(ScanKinds, NumpyArraysByRowsByColumnsAndStructured) {
  const Scan s = test::make_points(5);
  PointFile file;
  parse_npy(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (5, 4), }", test::bin_of(s)), "a.npy",
            file);
  test::expect_same_points(file.scan, s);
  std::string columns;
  for (const auto* axis : {&s.x, &s.y, &s.z})
    for (const float v : *axis) put(columns, static_cast<double>(v));
  parse_npy(npy("{'descr': '<f8', 'fortran_order': True, 'shape': (5, 3), }", columns), "a.npy", file);
  EXPECT_EQ(file.scan.y, s.y);
  parse_npy(
      npy("{'descr': [('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('stamp', '<f4')], 'fortran_order': False, "
          "'shape': (5,), }",
          test::bin_of(s)),
      "a.npy", file);
  EXPECT_EQ(file.scan.z, s.z);
  EXPECT_EQ(file.raw_time.size(), 5U);
  EXPECT_NE(error_of([&] {
              parse_npy(npy("{'descr': '<f4', 'fortran_order': False, 'shape': (6, 4), }", test::bin_of(s)),
                        "a.npy", file);
            }).find("truncated"),
            std::string::npos);
  EXPECT_NE(error_of([&] {
              parse_npy(npy("{'descr': '|O', 'fortran_order': False, 'shape': (5, 4), }", test::bin_of(s)),
                        "a.npy", file);
            }).find("|O"),
            std::string::npos);
}

TEST(ScanKinds, LasWithoutCompression) {
  std::string bytes(227, '\0');
  bytes.replace(0, 4, "LASF");
  bytes[24] = 1, bytes[25] = 2;
  const auto set = [&](std::size_t at, auto value) { std::memcpy(bytes.data() + at, &value, sizeof(value)); };
  set(96, std::uint32_t{227}), set(105, std::uint16_t{28}), set(107, std::uint32_t{2});
  bytes[104] = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) set(131 + 8 * axis, 0.001);
  set(155, 10.0);
  for (int i = 0; i < 2; ++i) {
    std::string point(28, '\0');
    for (int axis = 0; axis < 3; ++axis) {
      const std::int32_t v = 1000 * (axis + 1) + i;
      std::memcpy(point.data() + 4 * axis, &v, 4);
    }
    const double time = 5.0 + i;
    std::memcpy(point.data() + 20, &time, 8);
    bytes += point;
  }
  PointFile file;
  parse_las(bytes, "a.las", file);
  EXPECT_EQ(file.scan.x, (std::vector<float>{11.0F, 11.001F}));
  EXPECT_EQ(file.scan.z, (std::vector<float>{3.0F, 3.001F}));
  EXPECT_EQ(file.raw_time, (std::vector<double>{5.0, 6.0}));
  const TemporaryFolder folder;
  set(155, 5000.0);  // a scanner that sees far
  folder.write("a.las", bytes);
  SourceOptions metres;
  metres.points_unit = "m";
  EXPECT_FLOAT_EQ(open_source(folder.path() + "/a.las", metres)->read(0).x[0], 5001.0F);
  EXPECT_NE(error_of([&] { parse_las(bytes.substr(0, 270), "a.las", file); }).find("truncated"),
            std::string::npos);
  bytes[104] = static_cast<char>(0x81);
  EXPECT_NE(error_of([&] { parse_las(bytes, "a.las", file); }).find("compressed"), std::string::npos);
}

TEST(ScanKinds, GzippedScansAreRead) {
  const TemporaryFolder folder;
  const Scan scan = hall(true);
  const std::string raw = test::bin_of(scan);
  std::string packed(raw.size() + 1000, '\0');
  libdeflate_compressor* compressor = libdeflate_alloc_compressor(1);
  packed.resize(libdeflate_gzip_compress(compressor, raw.data(), raw.size(), packed.data(), packed.size()));
  libdeflate_free_compressor(compressor);
  folder.write("000000.bin.gz", packed);
  test::expect_same_points(open_source(folder.path())->read(0), scan);
  test::expect_same_points(open_source(folder.path() + "/000000.bin.gz")->read(0), scan);
  folder.write("000000.bin.gz", packed.substr(0, packed.size() / 2));
  EXPECT_NE(error_of([&] { open_source(folder.path())->read(0); }).find("gzip"), std::string::npos);
}

TEST(ScanKinds, NamesThatAreTimes) {
  EXPECT_EQ(stamp_of_name("1616169577783449888.pcd"), 1'616'169'577'783'449);
  EXPECT_EQ(stamp_of_name("1616169577783449.bin"), 1'616'169'577'783'449);
  EXPECT_EQ(stamp_of_name("1616169577.783449888.pcd"), 1'616'169'577'783'449);
  EXPECT_EQ(stamp_of_name("1616169577.5.pcd"), 1'616'169'577'500'000);
  EXPECT_EQ(stamp_of_name("cloud_1583836591_182590976.pcd"), 1'583'836'591'182'590);
  EXPECT_EQ(stamp_of_name("1583836591_82590976.pcd"), 1'583'836'591'082'590);
  EXPECT_EQ(stamp_of_name("n015-2018-07-18-11-18-34+0800__LIDAR_TOP__1531884539448719.pcd.bin"),
            1'531'884'539'448'719);
  for (const char* name :
       {"000012.bin", "scan_12.pcd", "cloud_12_5.pcd", "2018.07.pcd", "frame-1.5.ply", "a.bin"})
    EXPECT_EQ(stamp_of_name(name), -1) << name;
}

TEST(ScanKinds, TimeFieldsOfEveryName) {
  for (const char* name :
       {"t", "T_ns", "stamps", "time_stamp", "timestamps", "offset_time", "scalar_Time", "GpsTime"})
    EXPECT_TRUE(is_time_name(name)) << name;
  for (const char* name : {"tag", "ring", "tint", "intensity", "x"}) EXPECT_FALSE(is_time_name(name)) << name;
}

TEST(ScanKinds, WholeNumbersAreMillimetres) {
  const TemporaryFolder folder;
  const Scan scan = hall(false);
  std::string ply =
      "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(scan.size()) +
      "\nproperty short x\nproperty short y\nproperty short z\nproperty uchar quality\nend_header\n";
  for (std::size_t i = 0; i < scan.size(); ++i) {
    for (const float v : {scan.x[i], scan.y[i], scan.z[i]})
      put(ply, static_cast<std::int16_t>(std::lround(v * 1000.0F)));
    ply += '\x01';
  }
  folder.write("000000.ply", ply);
  const auto source = open_source(folder.path());
  expect_near(source->read(0), scan, 0.001F);
  std::string warnings;
  for (const std::string& w : source->warnings()) warnings += w + "\n";
  EXPECT_NE(warnings.find("millimetres"), std::string::npos);
  EXPECT_NE(warnings.find("quality"), std::string::npos);
}

TEST(ScanKinds, TypesInLowerCaseAsPclReadsThem) {
  PointFile file;
  parse_pcd(
      "VERSION .7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE f f f u\nWIDTH 1\nHEIGHT 1\nDATA ascii\n1 2 3 4\n",
      "a.pcd", file);
  EXPECT_EQ(file.scan.z, (std::vector<float>{3}));
  EXPECT_EQ(file.raw_time, (std::vector<double>{4}));
}

}  // namespace
}  // namespace hp2
