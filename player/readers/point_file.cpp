#include "player/readers/point_file.hpp"

#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "common/error.hpp"
#include "player/readers/bin_layout.hpp"
#include "player/readers/file_io.hpp"

namespace hp2 {

void read_points(const PointColumns& columns, std::size_t n, PointFile& out) {
  read_column(columns.x, n, out.scan.x);
  read_column(columns.y, n, out.scan.y);
  read_column(columns.z, n, out.scan.z);
  out.scan.intensity.clear();
  out.raw_time.clear();
  if (columns.intensity.first) read_column(columns.intensity, n, out.scan.intensity);
  if (columns.time.first) read_column(columns.time, n, out.raw_time);
}

void move_points(PointFile& file, Scan& scan) {
  std::swap(scan.x, file.scan.x);
  std::swap(scan.y, file.scan.y);
  std::swap(scan.z, file.scan.z);
  std::swap(scan.intensity, file.scan.intensity);
}

namespace {

constexpr std::size_t kRecord = 4 * sizeof(float);  // of a .bin file
static_assert(FilePieces::kPieceBytes % kRecord == 0, "a record lies in one piece");

// Makes room for the points of a .bin file.
void make_room(std::size_t bytes, const std::string& path, PointFile& out) {
  if (bytes % kRecord != 0)
    throw Error("the scan is truncated (" + std::to_string(bytes) + " bytes are no multiple of 16)", path,
                "Copy the file again; a .bin scan is float32 x y z intensity.");
  for (auto* axis : {&out.scan.x, &out.scan.y, &out.scan.z, &out.scan.intensity})
    axis->resize(bytes / kRecord);
  out.raw_time.clear();
}

// Points [begin, begin + bytes / 16), for which there is room.
void parse_records(std::string_view bytes, std::size_t begin, Scan& scan) {
  const std::size_t n = bytes.size() / kRecord;
  const char* __restrict from = bytes.data();  // without overlaps the compiler vectorises it
  float *__restrict x = scan.x.data() + begin, *__restrict y = scan.y.data() + begin,
                    *__restrict z = scan.z.data() + begin, *__restrict intensity = scan.intensity.data() + begin;
  for (std::size_t i = 0; i < n; ++i, from += kRecord) {
    std::memcpy(x + i, from, sizeof(float));
    std::memcpy(y + i, from + 4, sizeof(float));
    std::memcpy(z + i, from + 8, sizeof(float));
    std::memcpy(intensity + i, from + 12, sizeof(float));
  }
}

void read_bin(const std::string& path, PointFile& out) {
  FilePieces file(path);
  make_room(file.size(), path, out);
  std::size_t done = 0;
  for (std::string_view piece = file.next(); !piece.empty(); piece = file.next()) {
    parse_records(piece, done / kRecord, out.scan);
    done += piece.size();
  }
  if (done != file.size()) make_room(done, path, out);  // it shrank meanwhile
}

std::string extension_of(const std::string& path) {
  const std::size_t dot = path.rfind('.');
  std::string extension = dot == std::string::npos ? "" : path.substr(dot);
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

}  // namespace

void parse_bin(std::string_view bytes, const std::string& path, PointFile& out) {
  make_room(bytes.size(), path, out);
  parse_records(bytes, 0, out.scan);
}

const std::vector<std::string>& point_file_extensions() {
  static const std::vector<std::string> all = {".bin", ".pcd", ".ply", ".las", ".npy",
                                               ".xyz", ".csv", ".asc", ".txt"};
  return all;
}

void read_point_file(const std::string& path, PointFile& out, const BinLayout* layout) {
  std::string extension = extension_of(path);
  const bool packed = extension == ".gz";
  if (packed) extension = extension_of(path.substr(0, path.size() - 3));
  if (extension == ".bin" && !packed && (!layout || layout == &kitti_bin_layout()))
    return read_bin(path, out);
  thread_local FileBuffer buffer;  // kept from scan to scan: no allocation in steady state
  std::string_view bytes = buffer.load(path);
  std::string expanded;
  if (packed && !bytes.empty()) bytes = expanded = expand_gzip(bytes, path);
  if (bytes.empty()) {  // a scan of no points, whatever its kind
    out = PointFile{};
    return;
  }
  out.fields.clear();
  out.integer = false;
  if (extension == ".bin") return parse_bin(bytes, path, layout ? *layout : kitti_bin_layout(), out);
  if (extension == ".pcd") return parse_pcd(bytes, path, out);
  if (extension == ".ply") return parse_ply(bytes, path, out);
  if (extension == ".las") return parse_las(bytes, path, out);
  if (extension == ".npy") return parse_npy(bytes, path, out);
  for (const char* text : {".xyz", ".csv", ".asc", ".txt"})
    if (extension == text) return parse_text_points(bytes, path, out);
  throw Error("unknown kind of scan", path,
              "Scans are .bin, .pcd, .ply, .las, .npy or text (.xyz, .csv) files.");
}

std::vector<double> parse_ascii_table(std::string_view text, std::size_t n, std::size_t width,
                                      const std::string& path) {
  // A number takes two bytes with its separator, so a table cannot have more of them than that.
  const std::size_t most = (text.size() + 1) / 2;
  if (width == 0 || n > most / width)
    throw Error("the header promises " + std::to_string(n) + " points, the file has fewer", path,
                "The file is truncated or its header is wrong: write it again.");
  std::vector<double> table(n * width);
  const char* p = text.data();
  const char* const end = p + text.size();
  for (double& value : table) {
    while (p != end && std::isspace(static_cast<unsigned char>(*p))) ++p;
    if (p != end && *p == '+') ++p;
    const auto [rest, error] = std::from_chars(p, end, value);
    if (error == std::errc::invalid_argument)
      throw Error("the scan ends early or holds what is not a number",
                  path + ", byte " + std::to_string(p - text.data()) + " of its data",
                  "Write the file again.");
    if (error == std::errc::result_out_of_range) value = std::numeric_limits<double>::quiet_NaN();
    p = rest;
  }
  return table;
}

}  // namespace hp2
