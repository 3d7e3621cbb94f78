#include "player/readers/point_cloud2.hpp"

#include <cstring>

#include "common/error.hpp"

namespace hp2 {
namespace {

/// Takes little-endian values off the front of a message; throws when it is at its end.
class Cursor {
 public:
  Cursor(std::string_view bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  template <typename T>
  T take() {
    T value;
    std::memcpy(&value, take_bytes(sizeof(T)).data(), sizeof(T));
    return value;
  }
  std::string_view take_bytes(std::size_t n) {
    if (n > bytes_.size())
      throw Error("a PointCloud2 message is truncated", where_,
                  "The bag is damaged; run rosbag check on it.");
    const std::string_view taken = bytes_.substr(0, n);
    bytes_.remove_prefix(n);
    return taken;
  }
  std::string_view take_string() { return take_bytes(take<std::uint32_t>()); }

 private:
  std::string_view bytes_;
  const std::string& where_;
};

constexpr ScalarType kTypes[] = {ScalarType::kInt8,    ScalarType::kUint8,  ScalarType::kInt16,
                                 ScalarType::kUint16,  ScalarType::kInt32,  ScalarType::kUint32,
                                 ScalarType::kFloat32, ScalarType::kFloat64};

}  // namespace

std::int64_t point_cloud2_stamp(std::string_view message) {
  std::uint32_t head[3];  // sequence, seconds, nanoseconds
  if (message.size() < sizeof(head)) return -1;
  std::memcpy(head, message.data(), sizeof(head));
  if (head[1] == 0 && head[2] == 0) return -1;
  return static_cast<std::int64_t>(head[1]) * 1'000'000 + head[2] / 1000;
}

void parse_point_cloud2(std::string_view message, const std::string& where, PointFile& out) {
  Cursor cursor(message, where);
  cursor.take_bytes(12);  // sequence and stamp
  cursor.take_string();   // frame
  const std::size_t height = cursor.take<std::uint32_t>();
  const std::size_t width = cursor.take<std::uint32_t>();
  struct Field {
    std::string name;
    std::size_t offset;
    std::uint8_t type;
  };
  std::vector<Field> fields;
  const auto n_fields = cursor.take<std::uint32_t>();
  for (std::uint32_t i = 0; i < n_fields; ++i) {  // ends by itself when the message does
    Field field;
    field.name = std::string(cursor.take_string());
    field.offset = cursor.take<std::uint32_t>();
    field.type = cursor.take<std::uint8_t>();
    cursor.take<std::uint32_t>();  // count
    fields.push_back(field);
  }
  const bool big_endian = cursor.take<std::uint8_t>() != 0;
  const std::size_t step = cursor.take<std::uint32_t>();
  const std::size_t row_step = cursor.take<std::uint32_t>();
  const std::string_view data = cursor.take_string();
  const std::size_t n = width * height;  // 64 bits hold it
  out.scan = Scan{};
  out.raw_time.clear();
  if (n == 0) return;
  const bool fits = step > 0 && n <= data.size() / step &&
                    (height == 1 || (row_step >= width * step && row_step <= data.size() / (height - 1) &&
                                     row_step * (height - 1) + width * step <= data.size()));
  if (!fits)
    throw Error("a PointCloud2 message promises " + std::to_string(n) + " points of " + std::to_string(step) +
                    " bytes, but has " + std::to_string(data.size()) + " bytes",
                where, "The driver or the bag is damaged.");
  std::string packed;  // rows without what lies between them
  const char* base = data.data();
  if (height > 1 && row_step != width * step) {
    for (std::size_t row = 0; row < height; ++row) packed += data.substr(row * row_step, width * step);
    base = packed.data();
  }
  PointColumns c;
  for (const Field& field : fields) {
    if (field.type < 1 || field.type > 8) continue;
    const ScalarType type = kTypes[field.type - 1];
    if (field.offset + scalar_size(type) > step) continue;
    const Column column{base + field.offset, step, type, big_endian};
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
  if (!c.x.first || !c.y.first || !c.z.first)
    throw Error("a PointCloud2 message has no fields x, y and z", where,
                "Choose another topic with --topic.");
  read_points(c, n, out);
}

}  // namespace hp2
