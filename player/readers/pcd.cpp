// PCD files (Point Cloud Library's format, version 0.7 and before).
#include <cctype>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <vector>

#include <liblzf/lzf.h>

#include "common/error.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/point_file.hpp"

namespace hp2 {
namespace {

struct Field {
  std::string name;
  ScalarType type = ScalarType::kFloat32;
  std::size_t count = 1;   ///< Numbers per point.
  std::size_t offset = 0;  ///< Bytes from the point's first byte.
  std::size_t column = 0;  ///< Number of its first column in an ascii table.
};

struct Header {
  std::vector<Field> fields;
  std::size_t n = 0;       ///< Points.
  std::size_t stride = 0;  ///< Bytes per point.
  std::size_t width = 0;   ///< Numbers per point.
  std::string data;        ///< ascii, binary, binary_compressed
};

[[noreturn]] void fail(const std::string& what, const std::string& path) {
  throw Error(what, path, "Write the PCD file again, e.g. with pcl_convert_pcd_ascii_binary.");
}

std::vector<std::string> words(std::string_view line) {
  std::vector<std::string> result;
  std::size_t i = 0;
  while ((i = line.find_first_not_of(" \t", i)) != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(" \t", i), line.size());
    result.emplace_back(line.substr(i, end - i));
    i = end;
  }
  return result;
}

std::size_t count_of(const std::string& word, const std::string& path) {
  std::size_t value = 0;
  const auto [rest, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || rest != word.data() + word.size() || value > kMaxFileBytes)
    fail("the PCD header has an impossible number '" + word + "'", path);
  return value;
}

ScalarType type_of(const std::string& type, const std::string& size, const std::string& path) {
  std::string key = type + size;
  for (char& c : key) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));  // as PCL reads it
  const std::pair<const char*, ScalarType> known[] = {
      {"I1", ScalarType::kInt8},   {"U1", ScalarType::kUint8},  {"I2", ScalarType::kInt16},
      {"U2", ScalarType::kUint16}, {"I4", ScalarType::kInt32},  {"U4", ScalarType::kUint32},
      {"I8", ScalarType::kInt64},  {"U8", ScalarType::kUint64}, {"F4", ScalarType::kFloat32},
      {"F8", ScalarType::kFloat64}};
  for (const auto& [name, scalar] : known)
    if (key == name) return scalar;
  fail("the PCD header has an unknown type '" + type + "' of size '" + size + "'", path);
}

/// Reads the header and takes it off `bytes`.
Header parse_header(std::string_view& bytes, const std::string& path) {
  Header header;
  std::vector<std::string> names, sizes, types, counts;
  std::size_t width = 0, height = 1, points = 0;
  bool has_points = false;
  while (header.data.empty()) {
    const std::size_t end = bytes.substr(0, 65536).find('\n');
    if (end == std::string_view::npos) fail("the PCD header has no DATA line", path);
    std::string_view line = bytes.substr(0, end);
    bytes.remove_prefix(end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    std::vector<std::string> w = words(line);
    if (w.empty() || w[0][0] == '#') continue;
    const std::string key = w[0];
    w.erase(w.begin());
    if (key == "FIELDS" || key == "COLUMNS")
      names = w;
    else if (key == "SIZE")
      sizes = w;
    else if (key == "TYPE")
      types = w;
    else if (key == "COUNT")
      counts = w;
    else if (key == "WIDTH" && w.size() == 1)
      width = count_of(w[0], path);
    else if (key == "HEIGHT" && w.size() == 1)
      height = count_of(w[0], path);
    else if (key == "POINTS" && w.size() == 1)
      points = count_of(w[0], path), has_points = true;
    else if (key == "DATA" && w.size() == 1)
      header.data = w[0];
    else if (key != "VERSION" && key != "VIEWPOINT")
      fail("the PCD header has a line that is not understood", path);
  }
  if (names.empty() || names.size() > 1024 || sizes.size() != names.size() || types.size() != names.size() ||
      (!counts.empty() && counts.size() != names.size()))
    fail("the PCD header's FIELDS, SIZE, TYPE and COUNT do not match", path);
  for (std::size_t i = 0; i < names.size(); ++i) {
    Field field;
    field.name = names[i];
    field.type = type_of(types[i], sizes[i], path);
    field.count = counts.empty() ? 1 : count_of(counts[i], path);
    field.offset = header.stride;
    field.column = header.width;
    if (field.count > 65536) fail("the PCD header has an impossible COUNT", path);
    header.stride += field.count * scalar_size(field.type);
    header.width += field.count;
    header.fields.push_back(field);
  }
  // width and height are at most 2^30 each: the product fits 64 bits.
  header.n = has_points ? points : width * height;
  return header;
}

/// Columns of the point fields. `at(field)` gives the first byte, the stride is the field's own in a table by
/// columns.
template <typename At>
PointColumns columns_of(const Header& header, const std::string& path, const At& at) {
  PointColumns c;
  for (const Field& field : header.fields) {
    if (field.count == 0) continue;
    const Column column = at(field);
    if (field.name == "x")
      c.x = column;
    else if (field.name == "y")
      c.y = column;
    else if (field.name == "z")
      c.z = column;
    else if (is_intensity_name(field.name) && !c.intensity.first)
      c.intensity = column;
    else if (is_time_name(field.name) && !c.time.first)
      c.time = column;
  }
  if (!c.x.first || !c.y.first || !c.z.first) fail("the PCD file has no fields x, y and z", path);
  return c;
}

}  // namespace

void parse_pcd(std::string_view bytes, const std::string& path, PointFile& out) {
  const Header header = parse_header(bytes, path);
  if (header.n == 0) {
    out = PointFile{};
    return;
  }
  out.fields.clear();
  for (const Field& field : header.fields) {
    out.fields.push_back(field.name);
    if (field.name == "x")
      out.integer = field.type != ScalarType::kFloat32 && field.type != ScalarType::kFloat64;
  }
  const std::string lie = "the PCD header promises " + std::to_string(header.n) + " points of " +
                          std::to_string(header.stride) + " bytes, the file has " +
                          std::to_string(bytes.size()) + " bytes of data";
  if (header.data == "ascii") {
    const std::vector<double> table = parse_ascii_table(bytes, header.n, header.width, path);
    const char* base = reinterpret_cast<const char*>(table.data());
    const std::size_t stride = header.width * sizeof(double);
    return read_points(
        columns_of(header, path,
                   [&](const Field& f) {
                     return Column{base + f.column * sizeof(double), stride, ScalarType::kFloat64};
                   }),
        header.n, out);
  }
  if (header.stride == 0) fail("the PCD header describes points of no bytes", path);
  if (header.data == "binary") {
    if (header.n > bytes.size() / header.stride) fail(lie, path);
    return read_points(columns_of(header, path,
                                  [&](const Field& f) {
                                    return Column{bytes.data() + f.offset, header.stride, f.type};
                                  }),
                       header.n, out);
  }
  if (header.data != "binary_compressed") fail("unknown kind of PCD data '" + header.data + "'", path);
  std::uint32_t sizes[2] = {0, 0};  // compressed, expanded
  if (bytes.size() >= sizeof(sizes)) std::memcpy(sizes, bytes.data(), sizeof(sizes));
  if (bytes.size() < sizeof(sizes) || sizes[0] > bytes.size() - sizeof(sizes)) fail(lie, path);
  // LZF expands 3 bytes to at most 264: a header that claims more is wrong, and gets no memory.
  if (header.n != sizes[1] / header.stride || sizes[1] % header.stride != 0 || sizes[1] / 88 > sizes[0])
    fail(lie, path);
  std::vector<char> table(sizes[1]);
  const char* packed = bytes.data() + sizeof(sizes);
  const unsigned expanded = sizes[0] == 0 ? 0 : lzf_decompress(packed, sizes[0], table.data(), sizes[1]);
  if (expanded != sizes[1]) fail("the compressed PCD data is damaged", path);
  read_points(
      columns_of(header, path,
                 [&](const Field& f) {
                   // All points' x, then all points' y, ...: the table lies by columns.
                   return Column{table.data() + f.offset * header.n, f.count * scalar_size(f.type), f.type};
                 }),
      header.n, out);
}

}  // namespace hp2
