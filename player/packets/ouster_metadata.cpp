#include <cmath>
#include <initializer_list>

#include <nlohmann/json.hpp>

#include "common/error.hpp"
#include "player/packets/ouster.hpp"

namespace hp2 {
namespace {

using nlohmann::json;

/// The metadata, with the one or the other place of each part.
class Metadata {
 public:
  Metadata(const std::string& text, std::string where) : where_(std::move(where)) {
    root_ = json::parse(text, nullptr, false);
    if (root_.is_discarded()) fail("is no JSON");
    if (!root_.is_object()) fail("is no JSON object");
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw Error("the Ouster metadata " + what, where_,
                "Get it from the sensor again (http://SENSOR/api/v1/sensor/metadata).");
  }

  /// Value of `key` in the first of these parts that has it ("" is the top level); null if none has.
  const json* find(std::initializer_list<const char*> parts, const char* key) const {
    for (const std::string part : parts) {
      const json* object = &root_;
      if (!part.empty()) {
        const auto it = root_.find(part);
        if (it == root_.end() || !it->is_object()) continue;
        object = &*it;
      }
      const auto it = object->find(key);
      if (it != object->end() && !it->is_null()) return &*it;
    }
    return nullptr;
  }

  std::string text(std::initializer_list<const char*> parts, const char* key) const {
    const json* value = find(parts, key);
    if (!value) return "";
    if (value->is_number_unsigned()) return std::to_string(value->get<std::uint64_t>());
    if (!value->is_string()) fail("has no text as '" + std::string(key) + "'");
    return value->get<std::string>();
  }

  std::size_t count(const json& value, const std::string& key, std::size_t low, std::size_t high) const {
    if (!value.is_number_integer() || value.get<double>() < static_cast<double>(low) ||
        value.get<double>() > static_cast<double>(high))
      fail("has the impossible '" + key + "' " + value.dump());
    return value.get<std::size_t>();
  }

  std::vector<double> numbers(const json& value, const std::string& key) const {
    if (!value.is_array() || value.size() > 1'000'000) fail("has no list of numbers as '" + key + "'");
    std::vector<double> list;
    for (const json& v : value) {
      if (v.is_array()) {  // angles of every pixel, by rows
        const std::vector<double> row = numbers(v, key);
        list.insert(list.end(), row.begin(), row.end());
        continue;
      }
      if (!v.is_number() || !std::isfinite(v.get<double>())) fail("has what is no number in '" + key + "'");
      list.push_back(v.get<double>());
    }
    return list;
  }

 private:
  std::string where_;
  json root_;
};

std::size_t columns_of_mode(const Metadata& metadata) {
  const std::string mode = metadata.text({"", "config_params"}, "lidar_mode");
  for (const std::size_t columns : {512U, 1024U, 2048U, 4096U})
    if (mode.rfind(std::to_string(columns) + "x", 0) == 0) return columns;
  metadata.fail(mode.empty() ? "lacks 'columns_per_frame' and 'lidar_mode'"
                             : "has the unknown 'lidar_mode' " + mode);
}

}  // namespace

OusterInfo parse_ouster_metadata(const std::string& text, const std::string& where) {
  const Metadata metadata(text, where);
  OusterInfo info;
  const auto format = {"lidar_data_format", "data_format"};
  info.product = metadata.text({"sensor_info", ""}, "prod_line");
  info.serial_number = metadata.text({"sensor_info", ""}, "prod_sn");

  info.profile = metadata.text(format, "udp_profile_lidar");
  if (info.profile.empty()) info.profile = metadata.text({"config_params", ""}, "udp_profile_lidar");
  if (info.profile.empty()) info.profile = "LEGACY";  // the only one of firmware before 2.2
  info.fusa_header = info.profile.rfind("FUSA", 0) == 0 ||
                     metadata.text({"lidar_data_format", "config_params"}, "header_type") == "FUSA";

  for (const char* key : {"beam_altitude_angles", "beam_azimuth_angles"}) {
    const json* angles = metadata.find({"beam_intrinsics", ""}, key);
    if (!angles) metadata.fail("lacks '" + std::string(key) + "'");
    (key == std::string("beam_altitude_angles") ? info.altitude_deg : info.azimuth_deg) =
        metadata.numbers(*angles, key);
  }
  const json* value = metadata.find(format, "columns_per_frame");
  info.columns_per_frame =
      value ? metadata.count(*value, "columns_per_frame", 1, 8192) : columns_of_mode(metadata);
  value = metadata.find(format, "columns_per_packet");
  info.columns_per_packet = value ? metadata.count(*value, "columns_per_packet", 1, 256) : 16;
  value = metadata.find(format, "pixels_per_column");
  info.pixels_per_column =
      value ? metadata.count(*value, "pixels_per_column", 1, 1024) : info.altitude_deg.size();
  const std::size_t all = info.pixels_per_column * info.columns_per_frame;
  info.all_pixels =
      info.altitude_deg.size() == all && info.azimuth_deg.size() == all && all > info.pixels_per_column;
  if (!info.all_pixels && (info.altitude_deg.size() != info.pixels_per_column ||
                           info.azimuth_deg.size() != info.pixels_per_column))
    metadata.fail("has angles of " + std::to_string(info.altitude_deg.size()) + " and " +
                  std::to_string(info.azimuth_deg.size()) + " beams for " +
                  std::to_string(info.pixels_per_column) + " pixels a column");
  for (const double angle : info.altitude_deg)
    if (std::abs(angle) > 90.0)
      metadata.fail("has a beam's altitude of " + std::to_string(angle) + " degrees");

  info.window_last = info.columns_per_frame - 1;
  if ((value = metadata.find(format, "column_window"))) {
    if (!value->is_array() || value->size() != 2) metadata.fail("has no pair as 'column_window'");
    info.window_first = metadata.count((*value)[0], "column_window", 0, info.columns_per_frame - 1);
    info.window_last = metadata.count((*value)[1], "column_window", 0, info.columns_per_frame - 1);
  }

  // Of sensors whose metadata does not say it, as the manuals have it.
  info.origin_x_mm = info.product.rfind("OS-0", 0) == 0   ? 27.67
                     : info.product.rfind("OS-1", 0) == 0 ? 15.806
                     : info.product.rfind("OS-2", 0) == 0 ? 13.762
                                                          : 12.163;
  if ((value = metadata.find({"beam_intrinsics", ""}, "lidar_origin_to_beam_origin_mm"))) {
    if (!value->is_number()) metadata.fail("has no number as 'lidar_origin_to_beam_origin_mm'");
    info.origin_x_mm = value->get<double>();
  }
  if ((value = metadata.find({"beam_intrinsics", ""}, "beam_to_lidar_transform"))) {
    const std::vector<double> matrix = metadata.numbers(*value, "beam_to_lidar_transform");
    if (matrix.size() != 16) metadata.fail("has no 16 numbers as 'beam_to_lidar_transform'");
    info.origin_x_mm = matrix[3];
    info.origin_z_mm = matrix[11];
  }
  info.sensor_from_lidar = {-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1};
  if ((value = metadata.find({"lidar_intrinsics", ""}, "lidar_to_sensor_transform"))) {
    info.sensor_from_lidar = metadata.numbers(*value, "lidar_to_sensor_transform");
    if (info.sensor_from_lidar.size() != 16)
      metadata.fail("has no 16 numbers as 'lidar_to_sensor_transform'");
  }
  if (OusterLayout(info).fields().empty())
    metadata.fail("has the unknown 'udp_profile_lidar' " + info.profile);
  return info;
}

}  // namespace hp2
