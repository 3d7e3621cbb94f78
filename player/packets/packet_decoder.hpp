// A LiDAR's packets into scans. Readers of captures and bags pass packets in the order of arrival; no file is
// read here.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/scan.hpp"
#include "player/readers/drive.hpp"

namespace hp2 {

/// What is known of a sensor beside its packets.
struct PacketSensorOptions {
  std::string metadata;       ///< Ouster: text of the metadata JSON; "" if there is none.
  std::string metadata_name;  ///< Where the metadata came from, for error messages.
  std::string where;          ///< Where the packets came from, for error messages.
};

/// A turn of the sensor, or the part of one that was received, and where its packets are.
struct Turn {
  std::int64_t utime = 0;  ///< Start of the sweep [us]: the sensor's clock where it is near the receiver's.
  std::int64_t duration_us = 0;  ///< Length of the sweep [us].
  std::uint64_t first_key = 0;   ///< Least and greatest key of the packets that are needed to decode it.
  std::uint64_t last_key = 0;
  std::int64_t start_ns = 0;  ///< Start of the sweep by the sensor's clock [ns].
  double covered_deg = 0.0;   ///< Angle of which data were received [degrees].
  bool whole = false;         ///< Cut at both ends where one turn followed the other without a gap.
  Scan scan;                  ///< Points, and times in the sweep; empty if only the index is wanted.
};

/// What went wrong in a stream of packets.
struct PacketCounts {
  std::uint64_t packets = 0;    ///< Of this sensor, as they came.
  std::uint64_t doubled = 0;    ///< Left out: the same packet came before.
  std::uint64_t reordered = 0;  ///< Put back into their place.
  std::uint64_t late = 0;       ///< Left out: too late to be put back.
  std::uint64_t refused = 0;    ///< Not of this sensor's form, or with a time that cannot be.
  std::uint64_t lost = 0;       ///< Missing, by the gaps in the sensor's times.
};

/// Packets of one sensor into turns. One stream, one decoder, one thread.
class PacketDecoder {
 public:
  virtual ~PacketDecoder() = default;
  /// Takes the next packet (the payload of one UDP datagram); appends the turns that have ended now.
  /// @param received_us when it was received [us]; @param key anything that rises from packet to packet
  virtual void take(std::int64_t received_us, std::uint64_t key, std::string_view payload,
                    std::vector<Turn>& turns) = 0;
  /// There are no more packets: appends what is left.
  virtual void finish(std::vector<Turn>& turns) = 0;
  virtual const PacketCounts& counts() const = 0;
};

/// A sensor that was recognised: makes its decoders. Thread-safe.
class PacketSensor {
 public:
  virtual ~PacketSensor() = default;
  /// e.g. "vlp16", "hdl32e", "ouster OS-1-64", "hesai xt32".
  virtual const std::string& name() const = 0;
  /// Angle of a turn in which the sensor measures [degrees].
  virtual double window_deg() const = 0;
  /// Whether the packet is of this sensor's kind.
  virtual bool fits(std::string_view payload) const = 0;
  /// @param points whether the turns get their points, or are indexed only (which is much faster)
  virtual std::unique_ptr<PacketDecoder> make_decoder(bool points) const = 0;
};

/// The sensor that sends packets like this one; null if it is none that is known (positions, IMU, another
/// program's packets).
/// @throws Error if it is an Ouster's and the metadata is missing or malformed
std::shared_ptr<const PacketSensor> recognise_sensor(std::string_view payload,
                                                     const PacketSensorOptions& options);

/// Calls `use(received_us, key, payload)` for each of the stream's packets from the one with key `first` to
/// the one with key `last`, in their order. Called from several threads.
using UsePacket = std::function<void(std::int64_t, std::uint64_t, std::string_view)>;
using ReadPackets = std::function<void(std::uint64_t first, std::uint64_t last, const UsePacket& use)>;

/// The drive of the turns of one sensor: `read_packets` is called once for all packets (0 to 2^64 - 1) and
/// then for the packets of each scan that is read. Sets scans, warnings, decode and the sensor of `drive`.
/// @throws Error if there is no whole turn
void set_packet_scans(std::shared_ptr<const PacketSensor> sensor, ReadPackets read_packets, Drive& drive);

}  // namespace hp2
