// PLY files (Stanford polygon format 1.0): their vertices.
#include <charconv>
#include <vector>

#include "common/error.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/point_file.hpp"

namespace hp2 {
namespace {

struct Property {
  std::string name;
  ScalarType type = ScalarType::kFloat32;
  std::size_t offset = 0;  ///< Bytes from the element's first byte.
};

struct Element {
  std::string name;
  std::size_t n = 0;
  std::size_t stride = 0;
  bool has_list = false;  ///< Its size differs from element to element.
  std::vector<Property> properties;
};

[[noreturn]] void fail(const std::string& what, const std::string& path) {
  throw Error(what, path, "Write the PLY file again as a list of vertices with properties x, y and z.");
}

ScalarType type_of(std::string_view word, const std::string& path) {
  const std::pair<const char*, ScalarType> known[] = {
      {"char", ScalarType::kInt8},      {"int8", ScalarType::kInt8},       {"uchar", ScalarType::kUint8},
      {"uint8", ScalarType::kUint8},    {"short", ScalarType::kInt16},     {"int16", ScalarType::kInt16},
      {"ushort", ScalarType::kUint16},  {"uint16", ScalarType::kUint16},   {"int", ScalarType::kInt32},
      {"int32", ScalarType::kInt32},    {"uint", ScalarType::kUint32},     {"uint32", ScalarType::kUint32},
      {"float", ScalarType::kFloat32},  {"float32", ScalarType::kFloat32}, {"double", ScalarType::kFloat64},
      {"float64", ScalarType::kFloat64}};
  for (const auto& [name, type] : known)
    if (word == name) return type;
  fail("the PLY header has an unknown type '" + std::string(word) + "'", path);
}

std::vector<std::string_view> words(std::string_view line) {
  std::vector<std::string_view> result;
  std::size_t i = 0;
  while ((i = line.find_first_not_of(" \t", i)) != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(" \t", i), line.size());
    result.push_back(line.substr(i, end - i));
    i = end;
  }
  return result;
}

/// Reads the header and takes it off `bytes`.
std::vector<Element> parse_header(std::string_view& bytes, std::string& format, const std::string& path) {
  std::vector<Element> elements;
  bool first = true;
  while (true) {
    const std::size_t end = bytes.substr(0, 65536).find('\n');
    if (end == std::string_view::npos) fail("the PLY header has no end", path);
    std::string_view line = bytes.substr(0, end);
    bytes.remove_prefix(end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    const std::vector<std::string_view> w = words(line);
    if (first && (w.size() != 1 || w[0] != "ply")) fail("not a PLY file", path);
    first = false;
    if (w.empty() || w[0] == "ply" || w[0] == "comment" || w[0] == "obj_info") continue;
    if (w[0] == "end_header") return elements;
    if (w[0] == "format" && w.size() >= 2) {
      format = w[1];
    } else if (w[0] == "element" && w.size() == 3 && elements.size() < 64) {
      Element element;
      element.name = w[1];
      const auto [rest, error] = std::from_chars(w[2].data(), w[2].data() + w[2].size(), element.n);
      if (error != std::errc() || rest != w[2].data() + w[2].size() || element.n > kMaxFileBytes)
        fail("the PLY header has an impossible number '" + std::string(w[2]) + "'", path);
      elements.push_back(element);
    } else if (w[0] == "property" && w.size() >= 3 && !elements.empty()) {
      Element& element = elements.back();
      if (w[1] == "list") {
        element.has_list = true;
        continue;
      }
      Property property{std::string(w[2]), type_of(w[1], path), element.stride};
      element.stride += scalar_size(property.type);
      element.properties.push_back(property);
      if (element.properties.size() > 1024) fail("the PLY header has too many properties", path);
    } else {
      fail("the PLY header has a line that is not understood", path);
    }
  }
}

}  // namespace

void parse_ply(std::string_view bytes, const std::string& path, PointFile& out) {
  std::string format;
  const std::vector<Element> elements = parse_header(bytes, format, path);
  const bool ascii = format == "ascii";
  const bool big_endian = format == "binary_big_endian";
  if (!ascii && !big_endian && format != "binary_little_endian")
    fail("unknown PLY format '" + format + "'", path);
  // The vertices come first in every file met so far; what stands before them must at least be of a known
  // size.
  const Element* vertex = nullptr;
  for (const Element& element : elements) {
    if (element.has_list) break;
    if (element.name == "vertex") {
      vertex = &element;
      break;
    }
    if (ascii && element.n > 0) break;
    if (element.stride && element.n > bytes.size() / element.stride) fail("the PLY file is truncated", path);
    bytes.remove_prefix(element.n * element.stride);
  }
  if (!vertex) fail("the PLY file does not begin with vertices of plain properties", path);

  std::vector<double> table;
  const std::size_t width = vertex->properties.size();
  if (ascii)
    table = parse_ascii_table(bytes, vertex->n, width, path);
  else if (vertex->stride == 0 || vertex->n > bytes.size() / vertex->stride)
    fail("the PLY header promises " + std::to_string(vertex->n) + " vertices of " +
             std::to_string(vertex->stride) + " bytes, the file has " + std::to_string(bytes.size()) +
             " bytes of data",
         path);
  if (vertex->n == 0) return read_points({}, 0, out);
  out.fields.clear();
  for (const Property& p : vertex->properties) {
    out.fields.push_back(p.name);
    if (p.name == "x") out.integer = p.type != ScalarType::kFloat32 && p.type != ScalarType::kFloat64;
  }
  PointColumns c;
  for (std::size_t i = 0; i < width; ++i) {
    const Property& p = vertex->properties[i];
    const char* rows = reinterpret_cast<const char*>(table.data());
    const Column column =
        ascii ? Column{rows + i * sizeof(double), width * sizeof(double), ScalarType::kFloat64, false}
              : Column{bytes.data() + p.offset, vertex->stride, p.type, big_endian};
    if (p.name == "x")
      c.x = column;
    else if (p.name == "y")
      c.y = column;
    else if (p.name == "z")
      c.z = column;
    else if (is_intensity_name(p.name) && !c.intensity.first)
      c.intensity = column;
    else if (is_time_name(p.name) && !c.time.first)
      c.time = column;
  }
  if (vertex->n > 0 && (!c.x.first || !c.y.first || !c.z.first))
    fail("the PLY file's vertices have no properties x, y and z", path);
  read_points(c, vertex->n, out);
}

}  // namespace hp2
