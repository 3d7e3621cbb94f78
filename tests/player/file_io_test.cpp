#include "player/readers/file_io.hpp"

#include <filesystem>
#include <string>

#include <gtest/gtest.h>

#include "player/readers/point_file.hpp"
#include "player/scan_source.hpp"
#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::TemporaryFolder;

std::string some_bytes(std::size_t n) {
  std::string bytes;
  for (std::size_t i = 0; i < n; ++i) bytes.push_back(static_cast<char>(i * 7 + i / 251));
  return bytes;
}

TEST(FilePieces, AreTheFile) {
  const TemporaryFolder folder;
  constexpr std::size_t kPiece = FilePieces::kPieceBytes;
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{1}, kPiece - 1, kPiece, kPiece + 1, 3 * kPiece}) {
    const std::string bytes = some_bytes(size);
    FilePieces file(folder.write("f", bytes));
    EXPECT_EQ(file.size(), size);
    std::string read;
    for (auto piece = file.next(); !piece.empty(); piece = file.next()) read += piece;
    EXPECT_EQ(read, bytes) << size;
    EXPECT_TRUE(file.next().empty());
  }
}

TEST(FilePieces, EndWhereAFileThatShrinksEnds) {
  const TemporaryFolder folder;
  const std::string path = folder.write("f", some_bytes(3 * FilePieces::kPieceBytes));
  FilePieces file(path);
  EXPECT_EQ(file.next().size(), FilePieces::kPieceBytes);
  std::filesystem::resize_file(path, FilePieces::kPieceBytes + 10);
  EXPECT_EQ(file.next().size(), 10U);
  EXPECT_TRUE(file.next().empty());
}

TEST(FilePieces, RefuseWhatIsNoFile) {
  const TemporaryFolder folder;
  EXPECT_THROW(FilePieces{folder.path()}, Error);
  EXPECT_THROW(FilePieces{folder / "none"}, Error);
}

TEST(FilePieces, OfAScanAndItsTimesFitTogether) {
  constexpr std::size_t kPoints = 40'000;  // ten pieces of points, three of times
  const TemporaryFolder folder;
  const Scan points = test::make_points(kPoints);
  folder.write("velodyne/000000.bin", test::bin_of(points));
  std::string times;
  for (std::size_t i = 0; i < kPoints; ++i) test::put(times, static_cast<float>(i) / kPoints * 1.5F);
  folder.write("ptimes/000000.bin", times);
  SourceOptions options;
  options.bin_layout = "xyzi";  // points at random look like no scan
  options.points_unit = "m";
  const auto read = [&] { return open_source(folder.path(), options)->read(0); };
  Scan scan = read();
  EXPECT_EQ(scan.x, points.x);
  EXPECT_EQ(scan.y, points.y);
  EXPECT_EQ(scan.z, points.z);
  EXPECT_EQ(scan.intensity, points.intensity);
  ASSERT_EQ(scan.time.size(), kPoints);
  EXPECT_EQ(scan.time[20'000], 0.75F);
  EXPECT_EQ(scan.time.back(), 1.0F) << "no later than the sweep's end";

  times.replace(4 * 39'000, 4, "\xff\xff\xff\xff");  // no number
  folder.write("ptimes/000000.bin", times);
  EXPECT_TRUE(read().time.empty());
  folder.write("ptimes/000000.bin", times.substr(4));
  EXPECT_THROW(read(), Error);
}

}  // namespace
}  // namespace hp2
