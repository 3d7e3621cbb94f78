// Tables of points: text with one point per line, NumPy arrays, LAS (not compressed).
#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "common/error.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/point_file.hpp"

namespace hp2 {
namespace {

/// Which column of a table is what.
struct Roles {
  std::ptrdiff_t x = -1, y = -1, z = -1, intensity = -1, time = -1;
};

Roles roles_of_names(const std::vector<std::string>& names) {
  Roles roles;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto k = static_cast<std::ptrdiff_t>(i);
    if (names[i] == "x" || names[i] == "X") roles.x = k;
    if (names[i] == "y" || names[i] == "Y") roles.y = k;
    if (names[i] == "z" || names[i] == "Z") roles.z = k;
    if (roles.intensity < 0 && is_intensity_name(names[i])) roles.intensity = k;
    if (roles.time < 0 && is_time_name(names[i])) roles.time = k;
  }
  return roles;
}

/// x y z [intensity] [time]; further columns are not used.
Roles usual_roles(std::size_t width) { return {0, 1, 2, width > 3 ? 3 : -1, width > 4 ? 4 : -1}; }

bool is_number(std::string_view word) {
  double value = 0.0;
  const auto [rest, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && rest == word.data() + word.size();
}

std::vector<std::string> words_of(std::string_view line) {
  std::vector<std::string> words;
  constexpr std::string_view kSeparators = " \t,;\"";
  std::size_t i = 0;
  while ((i = line.find_first_not_of(kSeparators, i)) != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(kSeparators, i), line.size());
    words.emplace_back(line.substr(i, end - i));
    i = end;
  }
  return words;
}

template <typename T>
T number_at(std::string_view bytes, std::size_t at) {
  T value{};
  if (at + sizeof(T) <= bytes.size()) std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

/// NumPy's name of a type, e.g. "<f4".
bool numpy_type(std::string_view name, ScalarType& type, bool& big_endian) {
  if (name.size() < 3) return false;
  big_endian = name[0] == '>';
  const std::string_view rest = name.substr(1);
  const std::pair<const char*, ScalarType> known[] = {
      {"i1", ScalarType::kInt8},   {"u1", ScalarType::kUint8},  {"i2", ScalarType::kInt16},
      {"u2", ScalarType::kUint16}, {"i4", ScalarType::kInt32},  {"u4", ScalarType::kUint32},
      {"i8", ScalarType::kInt64},  {"u8", ScalarType::kUint64}, {"f4", ScalarType::kFloat32},
      {"f8", ScalarType::kFloat64}};
  for (const auto& [key, scalar] : known)
    if (rest == key) {
      type = scalar;
      return true;
    }
  return false;
}

/// Texts in quotes, in their order.
std::vector<std::string> quoted(std::string_view text) {
  std::vector<std::string> all;
  std::size_t i = 0;
  while ((i = text.find('\'', i)) != std::string_view::npos) {
    const std::size_t end = text.find('\'', i + 1);
    if (end == std::string_view::npos) break;
    all.emplace_back(text.substr(i + 1, end - i - 1));
    i = end + 1;
  }
  return all;
}

[[noreturn]] void refuse_npy(const std::string& what, const std::string& path) {
  throw Error(what, path, "Save the points as an array of N rows x y z [intensity] [time] with numpy.save.");
}

}  // namespace

void parse_text_points(std::string_view text, const std::string& path, PointFile& out) {
  out = PointFile{};
  if (text.substr(0, 3) == "\xef\xbb\xbf") text.remove_prefix(3);
  std::size_t number = 0, width = 0;
  Roles roles;
  for (const std::string_view line : split_lines(text)) {
    ++number;
    const std::size_t begin = line.find_first_not_of(" \t");
    if (begin == std::string_view::npos || line[begin] == '#' || line.substr(begin, 2) == "//") continue;
    if (width == 0) {  // the first line: names, a number of points, or a point
      const std::vector<std::string> words = words_of(line);
      if (words.size() == 1 && is_number(words[0])) continue;
      const bool names = !words.empty() && !is_number(words[0]) && words[0] != "nan" && words[0] != "NaN";
      width = words.size();
      roles = names ? roles_of_names(words) : usual_roles(width);
      if (names && (roles.x < 0 || roles.y < 0 || roles.z < 0)) roles = usual_roles(width);
      if (width < 3)
        throw Error("a line has fewer than three numbers", path + ", line " + std::to_string(number),
                    "A text file of points has x y z [intensity] [time] in every line.");
      if (names) continue;
    }
    const std::vector<double> values = parse_numbers(line);
    if (values.size() < width)
      throw Error("a line has " + std::to_string(values.size()) + " numbers where others have " +
                      std::to_string(width),
                  path + ", line " + std::to_string(number), "The file may be truncated: write it again.");
    const auto at = [&](std::ptrdiff_t column) { return values[static_cast<std::size_t>(column)]; };
    out.scan.x.push_back(static_cast<float>(at(roles.x)));
    out.scan.y.push_back(static_cast<float>(at(roles.y)));
    out.scan.z.push_back(static_cast<float>(at(roles.z)));
    if (roles.intensity >= 0) out.scan.intensity.push_back(static_cast<float>(at(roles.intensity)));
    if (roles.time >= 0) out.raw_time.push_back(at(roles.time));
  }
}

void parse_npy(std::string_view bytes, const std::string& path, PointFile& out) {
  if (bytes.size() < 12 || bytes.substr(0, 6) != "\x93NUMPY") refuse_npy("not a NumPy array", path);
  const bool first_version = bytes[6] == 1;
  const std::size_t begin = first_version ? 10 : 12;
  const std::size_t length =
      first_version ? number_at<std::uint16_t>(bytes, 8) : number_at<std::uint32_t>(bytes, 8);
  if (length > bytes.size() - begin) refuse_npy("the NumPy array's header is truncated", path);
  const std::string_view header = bytes.substr(begin, length), data = bytes.substr(begin + length);
  const std::size_t descr = header.find("'descr':"), shape_at = header.find("'shape':");
  const std::size_t open = header.find('(', shape_at), close = header.find(')', open);
  if (descr == std::string_view::npos || shape_at == std::string_view::npos ||
      close == std::string_view::npos)
    refuse_npy("the NumPy array's header is not understood", path);
  std::vector<double> shape;
  for (const double v : parse_numbers(header.substr(open + 1, close - open - 1))) shape.push_back(v);
  for (const double v : shape)
    if (!(v >= 0.0 && v <= 1e9)) refuse_npy("the NumPy array has an impossible shape", path);
  const bool by_columns = header.find("'fortran_order': True") != std::string_view::npos;

  struct Field {
    std::string name;
    std::size_t offset;
    ScalarType type;
    bool big_endian;
  };
  std::vector<Field> fields;
  std::size_t stride = 0;
  std::size_t rows = shape.empty() ? 0 : static_cast<std::size_t>(shape[0]);
  std::string_view type_text = header.substr(descr + 8);
  type_text.remove_prefix(std::min(type_text.find_first_not_of(' '), type_text.size()));
  const bool structured = !type_text.empty() && type_text[0] == '[';
  Roles roles;
  if (structured) {
    const std::vector<std::string> words = quoted(type_text.substr(0, type_text.find(']')));
    std::vector<std::string> names;
    for (std::size_t i = 0; i + 1 < words.size(); i += 2) {
      Field field{words[i], stride, ScalarType::kFloat32, false};
      if (!numpy_type(words[i + 1], field.type, field.big_endian))
        refuse_npy("the NumPy array has the unknown type '" + words[i + 1] + "'", path);
      stride += scalar_size(field.type);
      fields.push_back(field);
      names.push_back(field.name);
    }
    roles = roles_of_names(names);
    if (roles.x < 0 || roles.y < 0 || roles.z < 0)
      refuse_npy("the NumPy array has no fields x, y and z", path);
  } else {
    const std::vector<std::string> words = quoted(type_text);
    Field field{"", 0, ScalarType::kFloat32, false};
    if (words.empty() || !numpy_type(words[0], field.type, field.big_endian))
      refuse_npy("the NumPy array has the unknown type '" + (words.empty() ? "" : words[0]) + "'", path);
    // More than two dimensions are an image of points: the last one is the point.
    const std::size_t width = shape.size() < 2 ? 0 : static_cast<std::size_t>(shape.back());
    if (width < 3 || width > 64) refuse_npy("the NumPy array has no rows of at least three numbers", path);
    double points = 1.0;
    for (std::size_t i = 0; i + 1 < shape.size(); ++i) points *= shape[i];
    if (points > 1e9 || (by_columns && shape.size() > 2))
      refuse_npy("the NumPy array has an impossible shape", path);
    rows = static_cast<std::size_t>(points);
    const std::size_t size = scalar_size(field.type);
    for (std::size_t i = 0; i < width; ++i)
      fields.push_back({"", by_columns ? i * size * rows : i * size, field.type, field.big_endian});
    stride = by_columns ? size : size * width;
    roles = usual_roles(width);
  }
  const std::size_t needed = by_columns && !structured ? stride * fields.size() : stride;
  if (needed == 0 || rows > data.size() / needed)
    refuse_npy("the NumPy array is truncated (" + std::to_string(rows) + " points promised, " +
                   std::to_string(data.size()) + " bytes of data)",
               path);
  const auto column = [&](std::ptrdiff_t k) {
    if (k < 0 || rows == 0) return Column{};
    const Field& f = fields[static_cast<std::size_t>(k)];
    return Column{data.data() + f.offset, stride, f.type, f.big_endian};
  };
  read_points(
      {column(roles.x), column(roles.y), column(roles.z), column(roles.intensity), column(roles.time)}, rows,
      out);
}

void parse_las(std::string_view bytes, const std::string& path, PointFile& out) {
  const auto refuse = [&](const std::string& what) {
    throw Error(what, path, "Write the points as LAS without compression, e.g. with las2las or PDAL.");
  };
  if (bytes.size() < 227 || bytes.substr(0, 4) != "LASF") refuse("not a LAS file");
  const std::size_t begin = number_at<std::uint32_t>(bytes, 96);
  const unsigned format = static_cast<unsigned char>(bytes[104]);
  const std::size_t stride = number_at<std::uint16_t>(bytes, 105);
  if ((format & 0xc0U) != 0) refuse("the LAS file is compressed (LAZ)");
  if (format > 10) refuse("unknown format " + std::to_string(format) + " of LAS points");
  std::uint64_t n = number_at<std::uint32_t>(bytes, 107);
  if (n == 0 && bytes[25] >= 4) n = number_at<std::uint64_t>(bytes, 247);
  const std::size_t time_at = format == 1 || format == 3 || format == 4 || format == 5 ? 20
                              : format >= 6                                            ? 22
                                                                                       : 0;
  if (stride < (time_at > 0 ? time_at + 8 : 20))
    refuse("the LAS points are too short (" + std::to_string(stride) + " bytes)");
  if (begin > bytes.size() || n > (bytes.size() - begin) / stride)
    refuse("the LAS file is truncated (" + std::to_string(n) + " points promised, " +
           std::to_string(bytes.size()) + " bytes)");
  const char* base = bytes.data() + begin;
  if (n == 0) return read_points({}, 0, out);
  PointColumns columns;
  columns.intensity = {base + 12, stride, ScalarType::kUint16, false};
  if (time_at > 0) columns.time = {base + time_at, stride, ScalarType::kFloat64, false};
  std::vector<float>* const axes[] = {&out.scan.x, &out.scan.y, &out.scan.z};
  columns.x = {base, stride, ScalarType::kInt32, false};
  columns.y = {base + 4, stride, ScalarType::kInt32, false};
  columns.z = {base + 8, stride, ScalarType::kInt32, false};
  const Column raw[] = {columns.x, columns.y, columns.z};
  read_points(columns, n, out);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto scale = number_at<double>(bytes, 131 + 8 * axis);
    auto offset = number_at<double>(bytes, 155 + 8 * axis);
    if (!std::isfinite(scale) || !std::isfinite(offset))
      refuse("the LAS header has a scale or offset that is no number");
    if (std::abs(offset) > 1e4) offset = 0.0;  // a map's coordinates, which float32 does not hold
    std::vector<double> values;
    read_column(raw[axis], n, values);
    for (std::size_t i = 0; i < n; ++i) (*axes[axis])[i] = static_cast<float>(values[i] * scale + offset);
  }
}

}  // namespace hp2
