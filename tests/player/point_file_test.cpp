// PCD and PLY in all their kinds, times in their fields, and headers that lie.
#include "player/readers/point_file.hpp"

#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <liblzf/lzf.h>

#include "player/readers/file_io.hpp"
#include "player/scan_source.hpp"
#include "player/sweep/clock.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::error_of;
using test::make_points;
using test::put;
using ::testing::HasSubstr;

std::string pcd_header(std::size_t n, const std::string& data) {
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z pad intensity offset_time\nSIZE 4 4 4 1 4 4\nTYPE F F F U F "
         "U\n"
         "COUNT 1 1 1 3 1 1\nWIDTH " +
         std::to_string(n) + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + std::to_string(n) + "\nDATA " +
         data + "\n";
}

std::uint32_t time_of(std::size_t i, std::size_t n) {
  return static_cast<std::uint32_t>(i * 100'000'000 / (n - 1));  // [ns], 0 to 0.1 s
}

std::string pcd_rows(const Scan& s) {
  std::string bytes;
  for (std::size_t i = 0; i < s.size(); ++i) {
    put(bytes, s.x[i]);
    put(bytes, s.y[i]);
    put(bytes, s.z[i]);
    bytes += "abc";
    put(bytes, s.intensity[i]);
    put(bytes, time_of(i, s.size()));
  }
  return bytes;
}

std::string pcd_columns(const Scan& s) {
  std::string bytes;
  for (const auto* column : {&s.x, &s.y, &s.z})
    for (const float v : *column) put(bytes, v);
  for (std::size_t i = 0; i < s.size(); ++i) bytes += "abc";
  for (const float v : s.intensity) put(bytes, v);
  for (std::size_t i = 0; i < s.size(); ++i) put(bytes, time_of(i, s.size()));
  return bytes;
}

std::string lzf_compressed(const std::string& data) {
  std::string out(data.size() + data.size() / 16 + 64, '\0');
  out.resize(lzf_compress(data.data(), static_cast<unsigned>(data.size()), out.data(),
                          static_cast<unsigned>(out.size())));
  return out;
}

std::string pcd_compressed(const Scan& s, std::size_t claimed_points) {
  const std::string raw = pcd_columns(s);
  const std::string packed = lzf_compressed(raw);
  std::string bytes = pcd_header(claimed_points, "binary_compressed");
  put(bytes, static_cast<std::uint32_t>(packed.size()));
  put(bytes, static_cast<std::uint32_t>(raw.size()));
  return bytes + packed;
}

void expect_scan(const PointFile& file, const Scan& expected) {
  test::expect_same_points(file.scan, expected);
  ASSERT_EQ(file.raw_time.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_EQ(file.raw_time[i], static_cast<double>(time_of(i, expected.size())));
}

TEST(Pcd, AllThreeKindsGiveTheSamePoints) {
  const Scan scan = make_points(300);
  PointFile file;
  parse_pcd(pcd_header(300, "binary") + pcd_rows(scan), "a.pcd", file);
  expect_scan(file, scan);
  file = PointFile{};
  parse_pcd(pcd_compressed(scan, 300), "b.pcd", file);
  expect_scan(file, scan);
  file = PointFile{};
  std::string ascii = pcd_header(300, "ascii");
  for (std::size_t i = 0; i < 300; ++i)
    ascii += std::to_string(scan.x[i]) + " " + std::to_string(scan.y[i]) + " " + std::to_string(scan.z[i]) +
             " 1 2 3 " + std::to_string(scan.intensity[i]) + " " + std::to_string(time_of(i, 300)) + "\r\n";
  parse_pcd(ascii, "c.pcd", file);
  expect_scan(file, scan);
}

TEST(Pcd, NanIsPassedOnAndEmptyIsLegal) {
  PointFile file;
  parse_pcd("FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nDATA ascii\n1 nan 3\n-1e0 +2 inf\n",
            "a.pcd", file);
  EXPECT_TRUE(std::isnan(file.scan.y[0]));
  EXPECT_EQ(file.scan.y[1], 2.0F);
  EXPECT_TRUE(file.scan.intensity.empty());
  parse_pcd("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 0\nHEIGHT 1\nPOINTS 0\nDATA binary\n", "a.pcd",
            file);
  EXPECT_EQ(file.scan.size(), 0U);
}

TEST(Pcd, LyingHeaders) {
  const Scan scan = make_points(10);
  PointFile file;
  const auto fails = [&](const std::string& bytes) {
    return error_of([&] { parse_pcd(bytes, "bad.pcd", file); });
  };
  EXPECT_THAT(fails(pcd_header(11, "binary") + pcd_rows(scan)), HasSubstr("promises 11 points"));
  EXPECT_THAT(fails(pcd_header(1'000'000'000, "binary") + pcd_rows(scan)), HasSubstr("promises"));
  EXPECT_THAT(fails(pcd_header(1'000'000'000, "ascii") + "1 2 3"), HasSubstr("promises"));
  EXPECT_THAT(fails(pcd_header(10'000'000'000'000, "binary")), HasSubstr("impossible number"));
  EXPECT_THAT(fails(pcd_header(11, "binary_compressed") + pcd_rows(scan)), HasSubstr("promises"));
  EXPECT_THAT(fails(pcd_compressed(scan, 11)), HasSubstr("promises 11"));
  EXPECT_THAT(fails(pcd_compressed(scan, 10).substr(0, 300)), HasSubstr("promises"));
  std::string damaged = pcd_compressed(scan, 10);
  std::fill(damaged.end() - 100, damaged.end(),
            '\xff');  // copies of what is before the beginning, or cut off
  EXPECT_THAT(fails(damaged), HasSubstr("damaged"));
  const std::string nothing(4, '\0'),
      some("\x17\0\0\0", 4);  // sizes: none expands to the 23 bytes of one point
  EXPECT_THAT(fails(pcd_header(1, "binary_compressed") + nothing + some), HasSubstr("damaged"));
  EXPECT_THAT(fails("FIELDS x y z\nSIZE 4 4 3\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nDATA binary\n123456789012"),
              HasSubstr("unknown type"));
  EXPECT_THAT(fails("FIELDS x y\nSIZE 4 4\nTYPE F F\nWIDTH 1\nHEIGHT 1\nDATA binary\n12345678"),
              HasSubstr("x, y and z"));
  EXPECT_THAT(fails("FIELDS x y z\nSIZE 4 4\nTYPE F F F\nDATA binary\n"), HasSubstr("do not match"));
  EXPECT_THAT(fails("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\n"), HasSubstr("no DATA line"));
  EXPECT_THAT(fails("FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH -1\nDATA ascii\n"), HasSubstr("impossible"));
  EXPECT_THAT(fails(std::string(100'000, 'x')), HasSubstr("no DATA line"));
  EXPECT_THAT(fails(pcd_header(2, "ascii") + "1 2 3 4 5 6 7 8 9 words and words and words"),
              HasSubstr("not a number"));
}

TEST(Pcd, NoPrefixAndNoFlippedByteCrashes) {
  const std::string good = pcd_compressed(make_points(20), 20);
  PointFile file;
  for (std::size_t n = 0; n < good.size(); ++n)
    error_of([&] { parse_pcd(good.substr(0, n), "p.pcd", file); });
  std::mt19937 random(3);
  for (int k = 0; k < 20'000; ++k) {
    std::string bad = good;
    bad[random() % bad.size()] = static_cast<char>(random());
    error_of([&] { parse_pcd(bad, "p.pcd", file); });
    EXPECT_LT(file.scan.size(), 100'000U);
  }
}

std::string ply_header(const std::string& format, std::size_t n) {
  return "ply\nformat " + format + " 1.0\ncomment made by a test\nelement vertex " + std::to_string(n) +
         "\nproperty float x\nproperty float y\nproperty double z\nproperty uchar red\nproperty float "
         "intensity\n"
         "property uint t\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
}

template <typename T>
void put_swapped(std::string& bytes, T value) {
  std::string raw;
  put(raw, value);
  bytes.append(raw.rbegin(), raw.rend());
}

TEST(Ply, AllKindsGiveTheSamePoints) {
  const Scan scan = make_points(50);
  std::string little = ply_header("binary_little_endian", 50);
  std::string big = ply_header("binary_big_endian", 50);
  std::string ascii = ply_header("ascii", 50);
  for (std::size_t i = 0; i < 50; ++i) {
    put(little, scan.x[i]), put(little, scan.y[i]), put(little, static_cast<double>(scan.z[i])),
        little += '\7';
    put(little, scan.intensity[i]), put(little, time_of(i, 50));
    put_swapped(big, scan.x[i]), put_swapped(big, scan.y[i]),
        put_swapped(big, static_cast<double>(scan.z[i])), big += '\7';
    put_swapped(big, scan.intensity[i]), put_swapped(big, time_of(i, 50));
    ascii += std::to_string(scan.x[i]) + " " + std::to_string(scan.y[i]) + " " + std::to_string(scan.z[i]) +
             " 7 " + std::to_string(scan.intensity[i]) + " " + std::to_string(time_of(i, 50)) + "\n";
  }
  for (const std::string& bytes : {little + "junk", big, ascii + "3 0 1 2\n"}) {
    PointFile file;
    parse_ply(bytes, "a.ply", file);
    expect_scan(file, scan);
  }
  PointFile file;
  for (const std::string& bytes : {little, big}) {
    EXPECT_THAT(error_of([&] { parse_ply(bytes.substr(0, bytes.size() - 1), "a.ply", file); }),
                HasSubstr("promises 50"));
  }
  EXPECT_THAT(error_of([&] { parse_ply(ply_header("ascii", 1'000'000'000), "a.ply", file); }),
              HasSubstr("promises"));
  EXPECT_THAT(error_of([&] {
                parse_ply("ply\nformat ascii 1.0\nelement vertex 1\nproperty real x\n", "a.ply", file);
              }),
              HasSubstr("unknown type"));
  EXPECT_THAT(error_of([&] { parse_ply("not a ply\n", "a.ply", file); }), HasSubstr("not a PLY"));
}

TEST(Clock, UnitOfTimesInFields) {
  const auto unit_of = [](std::vector<double> t, std::int64_t step) {
    return find_time_unit({std::move(t)}, step);
  };
  EXPECT_EQ(unit_of({0, 5e7, 99.9e6}, 100'000).unit_s, 1e-9);
  EXPECT_EQ(unit_of({0, 5e7, 99.9e6}, 100'000).duration_us, 99'900);
  EXPECT_EQ(unit_of({0, 5e4, 99.9e3}, 100'000).unit_s, 1e-6);
  EXPECT_EQ(unit_of({0, 50, 99.9}, 100'000).unit_s, 1e-3);
  EXPECT_EQ(unit_of({0, 0.05, 0.0999}, 100'000).unit_s, 1.0);
  EXPECT_EQ(unit_of({1.6e9, 1.6e9 + 0.05, 1.6e9 + 0.1}, 100'000).unit_s, 1.0);
  EXPECT_TRUE(unit_of({0, 0.5, 0.999}, 100'000).normalised);
  EXPECT_EQ(unit_of({0, 0.5, 0.999}, 100'000).duration_us, 100'000);
  EXPECT_EQ(unit_of({0, 1e3, 7e14}, 100'000).unit_s, 0.0);

  Scan scan = make_points(3);
  apply_times({1.6e9, 1.6e9 + 0.05, 1.6e9 + 0.1}, unit_of({1.6e9, 1.6e9 + 0.1}, 100'000), scan);
  EXPECT_NEAR(scan.time[1], 0.5F, 1e-5);
  apply_times({1e7, 2e7, 3e7}, unit_of({0, 1e8}, 100'000),
              scan);  // a scan that lost its ends is not stretched
  EXPECT_NEAR(scan.time[0], 0.1F, 1e-6);
  EXPECT_NEAR(scan.time[2], 0.3F, 1e-6);
  apply_times({5, 5, 5}, unit_of({0, 1e8}, 100'000), scan);
  EXPECT_TRUE(scan.time.empty());
  apply_times({0, NAN, 1e8}, unit_of({0, 1e8}, 100'000), scan);
  EXPECT_TRUE(scan.time.empty());
}

TEST(Clock, PcdDriveWithTimeField) {
  const test::TemporaryFolder folder;
  for (std::size_t i = 0; i < 3; ++i)
    folder.write(test::number(i) + ".pcd", pcd_header(11, "binary") + pcd_rows(make_points(11)));
  folder.write("times.txt", "10\n10.1\n10.2\n");
  const auto source = open_source(folder.path());
  const Scan scan = source->read(1);
  EXPECT_EQ(scan.duration_us, 100'000);
  EXPECT_EQ(scan.utime, 10'050'000);
  ASSERT_EQ(scan.time.size(), 11U);
  for (std::size_t i = 0; i < 11; ++i) EXPECT_NEAR(scan.time[i], 0.1 * static_cast<double>(i), 1e-6);
}

TEST(FileIo, NaturalOrder) {
  EXPECT_TRUE(natural_less("scan2", "scan10"));
  EXPECT_FALSE(natural_less("scan10", "scan2"));
  EXPECT_TRUE(natural_less("9", "123456789012345678901234567890"));
  EXPECT_TRUE(natural_less("007", "8"));
  EXPECT_FALSE(natural_less("7", "7"));
  EXPECT_NE(natural_less("07", "7"), natural_less("7", "07"));
  EXPECT_TRUE(natural_less("a", "a1"));
}

}  // namespace
}  // namespace hp2
