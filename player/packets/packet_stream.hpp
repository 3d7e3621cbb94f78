// What all sensors' streams of packets have in common: packets in order and once each, turns cut from them,
// which turns are whole. A sensor adds a PacketFormat.
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "player/packets/packet_decoder.hpp"

namespace hp2 {

/// A packet that claims a later time (the year 2096) is damaged, or another sensor's [ns since 1970].
constexpr std::int64_t kMostPacketTime_ns = 4'000'000'000'000'000'000;

/// A part of a packet that is never cut: the firings that share one azimuth, or one column.
struct PacketBlock {
  double azimuth_deg = 0.0;  ///< In [0, 360), in the order of time; a turn ends where it passes 0.
  std::int64_t time_ns = 0;  ///< Start of the block after the packet's own time.
  std::int64_t turn = -1;    ///< Number of the turn, where the sensor gives it.
  std::size_t index = 0;     ///< Which block of the packet.
};

/// Points of a turn, before their times are relative to its start.
struct PacketPoints {
  std::vector<float> x, y, z, intensity;  ///< [m], sensor's own scale.
  std::vector<std::int64_t> time_ns;      ///< The sensor's clock.

  void add(double px, double py, double pz, double i, std::int64_t t) {
    x.push_back(static_cast<float>(px));
    y.push_back(static_cast<float>(py));
    z.push_back(static_cast<float>(pz));
    intensity.push_back(static_cast<float>(i));
    time_ns.push_back(t);
  }
};

/// How one model's packets are laid out. Thread-safe; called with packets that fit only.
class PacketFormat {
 public:
  virtual ~PacketFormat() = default;
  virtual const std::string& name() const = 0;
  /// Whether the packet has the length and the marks of this model.
  virtual bool fits(std::string_view payload) const = 0;
  /// The packet's time by the sensor's clock [ns].
  virtual std::int64_t time_ns(std::string_view payload) const = 0;
  /// After how long the sensor's clock starts again [ns]; 0: it does not.
  virtual std::int64_t clock_period_ns() const { return 0; }
  /// Replaces `blocks` by those of the packet that hold data, in the order of time.
  virtual void blocks(std::string_view payload, std::vector<PacketBlock>& blocks) const = 0;
  /// Appends the points of one block. @param packet_ns the packet's time, to which the points' offsets are
  /// added
  virtual void points(std::string_view payload, const PacketBlock& block, std::int64_t packet_ns,
                      PacketPoints& out) const = 0;
  /// Angle of a turn in which the sensor measures [degrees].
  virtual double window_deg() const { return 360.0; }
};

/// A sensor of this format.
std::shared_ptr<const PacketSensor> make_sensor(std::shared_ptr<const PacketFormat> format);

// The families; null if the packet is none of theirs.
std::shared_ptr<const PacketSensor> recognise_velodyne(std::string_view payload);
std::shared_ptr<const PacketSensor> recognise_hesai(std::string_view payload);
/// @throws Error if the packet looks like an Ouster's and the metadata is missing, malformed or another
/// sensor's
std::shared_ptr<const PacketSensor> recognise_ouster(std::string_view payload,
                                                     const PacketSensorOptions& options);

/// The number at `offset` of a packet, little-endian. The caller ensures that it lies inside.
template <typename T>
T packet_number(std::string_view payload, std::size_t offset) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i)
    value = static_cast<T>(
        value | static_cast<T>(static_cast<T>(static_cast<unsigned char>(payload[offset + i])) << (8 * i)));
  return value;
}

}  // namespace hp2
