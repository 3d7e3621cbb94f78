// Ouster's metadata JSON and the layout of the packets that it describes.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace hp2 {

/// A number of every pixel of a packet.
struct OusterField {
  const char* name;  ///< As Ouster's manual has it: RANGE, RANGE2, SIGNAL, REFLECTIVITY, NEAR_IR, ...
  std::size_t bit;   ///< First bit in the pixel's data.
  std::size_t bits;
  std::size_t upshift;  ///< Lower bits that the profile leaves out.
};

/// A sensor's metadata.
struct OusterInfo {
  std::string product;        ///< e.g. "OS-1-64"; "" if absent.
  std::string serial_number;  ///< "" if absent.
  std::string profile;        ///< LEGACY, RNG19_RFL8_SIG16_NIR16_DUAL, ...
  bool fusa_header = false;
  std::size_t columns_per_frame = 0, columns_per_packet = 0, pixels_per_column = 0;
  std::size_t window_first = 0, window_last = 0;  ///< Columns that are sent, both included; may pass 0.
  std::vector<double> altitude_deg, azimuth_deg;  ///< Of the beams; of all pixels by rows where `all_pixels`.
  bool all_pixels = false;                      ///< A sensor that does not turn (DF): angles of every pixel.
  double origin_x_mm = 0.0, origin_z_mm = 0.0;  ///< Of the beams, from the axis.
  std::vector<double> sensor_from_lidar;        ///< 4x4, rows; translation [mm].
};

/// Reads metadata of any firmware (one level or nested).
/// @param where for the error message
/// @throws Error if it is no JSON, lacks something, or contradicts itself
OusterInfo parse_ouster_metadata(const std::string& text, const std::string& where);

/// Offsets and sizes of a packet's fields. Offsets are within a packet of packet_bytes().
class OusterLayout {
 public:
  explicit OusterLayout(OusterInfo info);

  const OusterInfo& info() const { return info_; }
  std::size_t packet_bytes() const { return packet_bytes_; }
  const std::vector<OusterField>& fields() const { return fields_; }
  /// Field of this name; null if the profile has none.
  const OusterField* find_field(std::string_view name) const;

  std::uint64_t value(std::string_view payload, std::size_t column, std::size_t pixel,
                      const OusterField& field) const;
  std::int64_t timestamp_ns(std::string_view payload, std::size_t column) const;
  std::size_t measurement_id(std::string_view payload, std::size_t column) const;
  std::uint32_t status(std::string_view payload, std::size_t column) const;
  bool is_valid(std::string_view payload, std::size_t column) const;
  std::uint32_t frame_id(std::string_view payload) const;
  /// Whether the header marks a packet of points; always true for LEGACY, which has no header.
  bool is_points(std::string_view payload) const;
  /// Serial number in the header; 0 for LEGACY.
  std::uint64_t serial_number(std::string_view payload) const;

 private:
  std::size_t column_at(std::size_t column) const { return header_bytes_ + column * column_bytes_; }

  OusterInfo info_;
  std::vector<OusterField> fields_;
  bool legacy_ = false;
  std::size_t header_bytes_ = 0, column_header_bytes_ = 0, pixel_bytes_ = 0, column_bytes_ = 0,
              packet_bytes_ = 0;
};

/// Whether a payload of this size and beginning may be an Ouster's packet of points, of whatever profile.
bool may_be_ouster(std::string_view payload);

}  // namespace hp2
