#include "player/readers/bags/cloud_message.hpp"

#include <algorithm>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr ScalarType kTypes[] = {ScalarType::kInt8,    ScalarType::kUint8,  ScalarType::kInt16,
                                 ScalarType::kUint16,  ScalarType::kInt32,  ScalarType::kUint32,
                                 ScalarType::kFloat32, ScalarType::kFloat64};

/// A PointField: where a number lies in a point.
struct Field {
  std::string name;
  std::size_t offset = 0;
  std::uint8_t type = 0;
};

/// A PointCloud2 up to its data.
struct Layout {
  std::size_t height = 0, width = 0;
  std::vector<Field> fields;
  bool big_endian = false;
  std::size_t step = 0, row_step = 0;
};

Layout take_layout(MessageReader& reader, CloudMessage& out) {
  out.header = reader.take_header();
  Layout layout;
  layout.height = reader.take<std::uint32_t>();
  layout.width = reader.take<std::uint32_t>();
  out.points = layout.height * layout.width;  // 64 bits hold it
  const auto n = reader.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < n; ++i) {  // ends by itself when the message does
    Field field;
    field.name = std::string(reader.take_string());
    field.offset = reader.take<std::uint32_t>();
    field.type = reader.take<std::uint8_t>();
    reader.take<std::uint32_t>();  // count
    out.layout += field.name + ':' + std::to_string(field.offset) + ':' + std::to_string(field.type) + ' ';
    layout.fields.push_back(std::move(field));
  }
  layout.big_endian = reader.take<std::uint8_t>() != 0;
  layout.step = reader.take<std::uint32_t>();
  layout.row_step = reader.take<std::uint32_t>();
  return layout;
}

/// The first point, rows without gaps. Rows lie one behind the other where row_step is invalid.
/// @throws Error if the data are fewer than the points need
const char* find_points(const Layout& layout, std::string_view data, const std::string& where,
                        CloudMessage& out) {
  const std::size_t row = layout.width * layout.step;
  if (layout.step == 0 || out.points > data.size() / layout.step)
    throw Error("a PointCloud2 message promises " + std::to_string(out.points) + " points of " +
                    std::to_string(layout.step) + " bytes, but has " + std::to_string(data.size()) + " bytes",
                where, "The driver or the recording is damaged.");
  const bool has_gaps = layout.height > 1 && layout.row_step > row &&
                        layout.row_step <= (data.size() - row) / (layout.height - 1);
  if (!has_gaps) return data.data();
  for (std::size_t i = 0; i < layout.height; ++i) out.packed += data.substr(i * layout.row_step, row);
  return out.packed.data();
}

void set_columns(const Layout& layout, const char* first, const std::string& where, PointColumns& c) {
  for (const Field& field : layout.fields) {
    if (field.type < 1 || field.type > 8) continue;
    const ScalarType type = kTypes[field.type - 1];
    if (field.offset + scalar_size(type) > layout.step) continue;
    const Column column{first + field.offset, layout.step, type, layout.big_endian};
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
  if (c.x.first && c.y.first && c.z.first) return;
  std::string names;
  for (const Field& field : layout.fields) names += (names.empty() ? "" : ", ") + field.name;
  throw Error("a PointCloud2 message has no fields x, y and z (it has: " + names + ")", where,
              "Choose another topic with --topic.");
}

void parse_point_cloud2(MessageReader& reader, CloudMessage& out) {
  const Layout layout = take_layout(reader, out);
  const std::string_view data = reader.take_bytes(reader.take_count(1));
  if (out.points == 0) return;
  set_columns(layout, find_points(layout, data, reader.where(), out), reader.where(), out.columns);
}

bool is_livox(const std::string& type) {
  const std::size_t slash = type.find('/');
  return slash != std::string::npos && type.substr(slash) == "/CustomMsg" && type.find("livox") == 0;
}

constexpr std::size_t kLivoxPoint = 19;  // offset_time, x, y, z, reflectivity, tag, line

void take_livox_head(MessageReader& reader, CloudMessage& out) {
  out.header = reader.take_header();
  out.base_us = static_cast<std::int64_t>(reader.take<std::uint64_t>() / 1000);  // timebase [ns]
  if (*out.base_us == 0) out.base_us.reset();
  reader.take<std::uint32_t>();  // number of points; the sequence's own is what counts
  reader.take_bytes(4);          // sensor, reserved
  out.layout = "CustomMsg";
  out.points = reader.take<std::uint32_t>();
}

void parse_livox(MessageReader& reader, CloudMessage& out) {
  take_livox_head(reader, out);
  if (out.points == 0) return;
  const std::size_t stride = reader.is_cdr() ? kLivoxPoint + 1 : kLivoxPoint;
  reader.align(4);
  if (reader.left() < kLivoxPoint || out.points - 1 > (reader.left() - kLivoxPoint) / stride)
    throw Error("a CustomMsg message promises " + std::to_string(out.points) + " points of " +
                    std::to_string(stride) + " bytes, but has " + std::to_string(reader.left()) + " bytes",
                reader.where(), "The driver or the recording is damaged.");
  const char* first = reader.take_bytes(kLivoxPoint).data();
  const bool big = reader.big_endian();
  out.columns.time = {first, stride, ScalarType::kUint32, big};
  out.columns.x = {first + 4, stride, ScalarType::kFloat32, big};
  out.columns.y = {first + 8, stride, ScalarType::kFloat32, big};
  out.columns.z = {first + 12, stride, ScalarType::kFloat32, big};
  out.columns.intensity = {first + 16, stride, ScalarType::kUint8, big};
}

void clear(CloudMessage& out) {
  out.columns = {};
  out.packed.clear();
  out.layout.clear();
  out.base_us.reset();
}

}  // namespace

bool is_cloud_type(const std::string& type) { return type == "sensor_msgs/PointCloud2" || is_livox(type); }

void parse_cloud_head(std::string_view head, const std::string& type, Encoding encoding,
                      const std::string& where, CloudMessage& out) {
  clear(out);
  MessageReader reader(head, encoding, where);
  if (is_livox(type))
    take_livox_head(reader, out);
  else
    take_layout(reader, out);
}

void parse_cloud(std::string_view message, const std::string& type, Encoding encoding,
                 const std::string& where, CloudMessage& out) {
  clear(out);
  MessageReader reader(message, encoding, where);
  if (is_livox(type))
    parse_livox(reader, out);
  else
    parse_point_cloud2(reader, out);
}

}  // namespace hp2
