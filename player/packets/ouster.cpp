// Ouster OS0, OS1, OS2 (and DF): packets of columns in the layout of the metadata's profile.
#include "player/packets/ouster.hpp"

#include <cmath>
#include <cstring>

#include "common/error.hpp"
#include "player/packets/packet_stream.hpp"

namespace hp2 {
namespace {

struct Profile {
  const char* name;
  std::size_t pixel_bytes;
  std::vector<OusterField> fields;
};

const std::vector<Profile>& profiles() {
  const std::vector<OusterField> single = {{"RANGE", 0, 19, 0},
                                           {"FLAGS", 19, 5, 0},
                                           {"REFLECTIVITY", 32, 8, 0},
                                           {"SIGNAL", 48, 16, 0},
                                           {"NEAR_IR", 64, 16, 0}};
  const std::vector<OusterField> dual = {
      {"RANGE", 0, 19, 0},  {"FLAGS", 19, 5, 0},         {"REFLECTIVITY", 24, 8, 0}, {"RANGE2", 32, 19, 0},
      {"FLAGS2", 51, 5, 0}, {"REFLECTIVITY2", 56, 8, 0}, {"SIGNAL", 64, 16, 0},      {"SIGNAL2", 80, 16, 0}};
  const std::vector<OusterField> low = {{"RANGE", 0, 15, 3}, {"FLAGS", 15, 1, 0}, {"REFLECTIVITY", 16, 8, 0}};
  const std::vector<OusterField> low_dual = {
      {"RANGE", 0, 15, 3},   {"FLAGS", 15, 1, 0},  {"REFLECTIVITY", 16, 8, 0}, {"NEAR_IR", 24, 8, 4},
      {"RANGE2", 32, 15, 3}, {"FLAGS2", 47, 1, 0}, {"REFLECTIVITY2", 48, 8, 0}};
  const auto with = [](std::vector<OusterField> fields, const OusterField& more) {
    fields.push_back(more);
    return fields;
  };
  static const std::vector<Profile> all = {
      {"LEGACY",
       12,
       {{"RANGE", 0, 20, 0},
        {"FLAGS", 28, 4, 0},
        {"REFLECTIVITY", 32, 8, 0},
        {"SIGNAL", 48, 16, 0},
        {"NEAR_IR", 64, 16, 0}}},
      {"RNG19_RFL8_SIG16_NIR16", 12, single},
      {"RNG19_RFL8_SIG16_NIR16_ZONE16", 12, single},
      {"RNG19_RFL8_SIG16_NIR16_DUAL", 16, with(dual, {"NEAR_IR", 96, 16, 0})},
      {"RNG19_RFL8_SIG16_ZONE16_DUAL", 16, dual},
      {"FIVE_WORD_PIXEL", 20, with(dual, {"NEAR_IR", 96, 16, 0})},
      {"RNG15_RFL8_NIR8", 4, with(low, {"NEAR_IR", 24, 8, 4})},
      {"RNG15_RFL8_WIN8", 4, low},
      {"RNG15_RFL8_NIR8_ZONE16", 8, with(low, {"NEAR_IR", 24, 8, 4})},
      {"RNG15_RFL8_NIR8_DUAL", 8, low_dual},
      {"FUSA_RNG15_RFL8_NIR8_DUAL", 8, low_dual}};
  return all;
}

template <typename T>
T number_at(std::string_view payload, std::size_t at) {
  T value;
  std::memcpy(&value, payload.data() + at, sizeof(T));
  return value;
}

class OusterFormat final : public PacketFormat {
 public:
  explicit OusterFormat(OusterInfo info) : layout_(std::move(info)) {
    const OusterInfo& i = layout_.info();
    name_ = "ouster" + (i.product.empty() ? "" : " " + i.product);
    ranges_ = {layout_.find_field("RANGE"), layout_.find_field("RANGE2")};
    const bool signal = layout_.find_field("SIGNAL") != nullptr;
    intensities_ = {layout_.find_field(signal ? "SIGNAL" : "REFLECTIVITY"),
                    layout_.find_field(signal ? "SIGNAL2" : "REFLECTIVITY2")};
    const std::size_t sent = (i.window_last + i.columns_per_frame - i.window_first) % i.columns_per_frame + 1;
    window_deg_ = 360.0 * static_cast<double>(sent) / static_cast<double>(i.columns_per_frame);
  }

  const std::string& name() const override { return name_; }
  double window_deg() const override { return window_deg_; }
  bool fits(std::string_view payload) const override {
    if (payload.size() != layout_.packet_bytes() || !layout_.is_points(payload)) return false;
    bool any = false;
    for (std::size_t c = 0; c < layout_.info().columns_per_packet; ++c) {
      if (!layout_.is_valid(payload, c)) continue;
      any = true;
      if (layout_.measurement_id(payload, c) >= layout_.info().columns_per_frame ||
          layout_.timestamp_ns(payload, c) < 0 || layout_.timestamp_ns(payload, c) > kMostPacketTime_ns)
        return false;
    }
    return any;
  }
  std::int64_t time_ns(std::string_view payload) const override {
    for (std::size_t c = 0; c < layout_.info().columns_per_packet; ++c)
      if (layout_.is_valid(payload, c)) return layout_.timestamp_ns(payload, c);
    return 0;
  }
  void blocks(std::string_view payload, std::vector<PacketBlock>& out) const override {
    out.clear();
    const std::int64_t start = time_ns(payload);
    for (std::size_t c = 0; c < layout_.info().columns_per_packet; ++c)
      if (layout_.is_valid(payload, c))
        out.push_back({360.0 * static_cast<double>(layout_.measurement_id(payload, c)) /
                           static_cast<double>(layout_.info().columns_per_frame),
                       layout_.timestamp_ns(payload, c) - start, layout_.frame_id(payload), c});
  }

  void points(std::string_view payload, const PacketBlock& block, std::int64_t packet_ns,
              PacketPoints& out) const override {
    const OusterInfo& info = layout_.info();
    const std::size_t id = layout_.measurement_id(payload, block.index);
    const double encoder =
        info.all_pixels
            ? 0.0
            : 2.0 * M_PI * (1.0 - static_cast<double>(id) / static_cast<double>(info.columns_per_frame));
    const double ce = std::cos(encoder), se = std::sin(encoder);
    const double origin_mm = std::hypot(info.origin_x_mm, info.origin_z_mm);
    const std::vector<double>& m = info.sensor_from_lidar;
    for (std::size_t p = 0; p < info.pixels_per_column; ++p) {
      const std::size_t angle = info.all_pixels ? p * info.columns_per_frame + id : p;
      const double azimuth =
          encoder + (info.all_pixels ? 1.0 : -1.0) * info.azimuth_deg[angle] * M_PI / 180.0;
      const double altitude = info.altitude_deg[angle] * M_PI / 180.0;
      std::uint64_t first = 0;
      for (std::size_t k = 0; k < 2 && ranges_[k]; ++k) {
        const std::uint64_t range = layout_.value(payload, block.index, p, *ranges_[k]);
        if (range == 0 || (k == 1 && range == first)) continue;
        first = range;
        const double r = static_cast<double>(range) - origin_mm;
        const double x = r * std::cos(azimuth) * std::cos(altitude) + info.origin_x_mm * ce;
        const double y = r * std::sin(azimuth) * std::cos(altitude) + info.origin_x_mm * se;
        const double z = r * std::sin(altitude) + info.origin_z_mm;
        const auto* intensity = intensities_[k] ? intensities_[k] : intensities_[0];
        out.add(0.001 * (m[0] * x + m[1] * y + m[2] * z + m[3]),
                0.001 * (m[4] * x + m[5] * y + m[6] * z + m[7]),
                0.001 * (m[8] * x + m[9] * y + m[10] * z + m[11]),
                intensity ? static_cast<double>(layout_.value(payload, block.index, p, *intensity)) : 0.0,
                packet_ns + block.time_ns);
      }
    }
  }

 private:
  const OusterLayout layout_;
  std::string name_;
  std::vector<const OusterField*> ranges_, intensities_;
  double window_deg_ = 360.0;
};

}  // namespace

OusterLayout::OusterLayout(OusterInfo info) : info_(std::move(info)) {
  legacy_ = info_.profile == "LEGACY";
  for (const Profile& profile : profiles()) {
    if (info_.profile != profile.name) continue;
    fields_ = profile.fields;
    pixel_bytes_ = profile.pixel_bytes;
  }
  header_bytes_ = legacy_ ? 0 : 32;
  column_header_bytes_ = legacy_ ? 16 : 12;
  column_bytes_ = column_header_bytes_ + info_.pixels_per_column * pixel_bytes_ + (legacy_ ? 4 : 0);
  packet_bytes_ = header_bytes_ + info_.columns_per_packet * column_bytes_ + (legacy_ ? 0 : 32);
}

const OusterField* OusterLayout::find_field(std::string_view name) const {
  for (const OusterField& field : fields_)
    if (name == field.name) return &field;
  return nullptr;
}

std::uint64_t OusterLayout::value(std::string_view payload, std::size_t column, std::size_t pixel,
                                  const OusterField& field) const {
  // No field crosses the 32 bits that it begins in.
  const std::size_t at = column_at(column) + column_header_bytes_ + pixel * pixel_bytes_ + field.bit / 32 * 4;
  const std::uint64_t word = number_at<std::uint32_t>(payload, at) >> (field.bit % 32);
  return (word & ((std::uint64_t{1} << field.bits) - 1)) << field.upshift;
}

std::int64_t OusterLayout::timestamp_ns(std::string_view payload, std::size_t column) const {
  return number_at<std::int64_t>(payload, column_at(column));
}

std::size_t OusterLayout::measurement_id(std::string_view payload, std::size_t column) const {
  return number_at<std::uint16_t>(payload, column_at(column) + 8);
}

std::uint32_t OusterLayout::status(std::string_view payload, std::size_t column) const {
  if (legacy_) return number_at<std::uint32_t>(payload, column_at(column) + column_bytes_ - 4);
  return number_at<std::uint16_t>(payload, column_at(column) + 10);
}

bool OusterLayout::is_valid(std::string_view payload, std::size_t column) const {
  return legacy_ ? status(payload, column) == 0xffffffffU : (status(payload, column) & 1U) != 0;
}

std::uint32_t OusterLayout::frame_id(std::string_view payload) const {
  if (legacy_) return number_at<std::uint16_t>(payload, 10);
  return info_.fusa_header ? number_at<std::uint32_t>(payload, 4) : number_at<std::uint16_t>(payload, 2);
}

bool OusterLayout::is_points(std::string_view payload) const {
  return legacy_ || (info_.fusa_header ? payload[0] == 1 : number_at<std::uint16_t>(payload, 0) == 1);
}

std::uint64_t OusterLayout::serial_number(std::string_view payload) const {
  if (legacy_) return 0;
  std::uint64_t number = 0;
  std::memcpy(&number, payload.data() + (info_.fusa_header ? 11 : 7), 5);
  return number;
}

bool may_be_ouster(std::string_view payload) {
  for (const Profile& profile : profiles()) {
    const bool legacy = profile.name == std::string("LEGACY");
    for (const std::size_t pixels : {16U, 32U, 64U, 128U}) {
      const std::size_t bytes = 16 * ((legacy ? 20 : 12) + pixels * profile.pixel_bytes) + (legacy ? 0 : 64);
      if (payload.size() != bytes) continue;
      if (legacy) {
        const auto status = number_at<std::uint32_t>(payload, bytes / 16 - 4);
        return status == 0 || status == 0xffffffffU;
      }
      return payload[0] == 1 && (payload[1] == 0 || std::string(profile.name).rfind("FUSA", 0) == 0);
    }
  }
  return false;
}

std::shared_ptr<const PacketSensor> recognise_ouster(std::string_view payload,
                                                     const PacketSensorOptions& options) {
  if (options.metadata.empty()) {
    if (!may_be_ouster(payload)) return nullptr;
    throw Error(
        "the packets are an Ouster's, whose metadata is missing", options.where,
        "Put the sensor's metadata beside the file, named as it is but with the ending .json, or name it "
        "with --metadata.");
  }
  auto format =
      std::make_shared<OusterFormat>(parse_ouster_metadata(options.metadata, options.metadata_name));
  if (!format->fits(payload)) return nullptr;
  return make_sensor(std::move(format));
}

}  // namespace hp2
