// A drive from a packet capture: which sensors it holds, and the scans of one of them.
#include <algorithm>
#include <map>
#include <tuple>

#include "common/error.hpp"
#include "player/packets/capture.hpp"
#include "player/packets/ouster.hpp"
#include "player/packets/packet_decoder.hpp"
#include "player/readers/file_io.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kLookedAt = 50'000;  // datagrams among which all sensors are expected
constexpr std::size_t kSamples = 6;        // sizes of datagrams of a sender that are tried

/// What one sender sends to one port.
struct Sender {
  std::map<std::size_t, std::string> samples;  ///< The first datagram of each size.
  std::size_t datagrams = 0;
  std::shared_ptr<const PacketSensor> sensor;
};

struct Metadata {
  std::string name, text;
};

/// Metadata JSONs that belong to the capture by their names, the nearest name first.
std::vector<Metadata> metadata_of(const std::string& path, const std::string& named) {
  if (!named.empty()) return {{named, read_text(named)}};
  const std::string folder = parent_folder(path), stem_of_capture = stem(base_name(path));
  std::vector<std::pair<std::size_t, std::string>> found;
  for (const std::string& name : list_files(folder, ".json")) {
    const std::string s = stem(name);
    const bool longer = s.rfind(stem_of_capture, 0) == 0, shorter = stem_of_capture.rfind(s, 0) == 0;
    if (longer || shorter)
      found.emplace_back(
          longer ? s.size() - stem_of_capture.size() : 1000 + stem_of_capture.size() - s.size(), name);
  }
  std::sort(found.begin(), found.end());
  std::vector<Metadata> all;
  for (const auto& [distance, name] : found)
    all.push_back({folder + "/" + name, read_text(folder + "/" + name)});
  return all;
}

/// The sensor that sends such packets, with the metadata that fits it, if it needs any.
std::shared_ptr<const PacketSensor> sensor_of(std::string_view payload, const std::vector<Metadata>& metadata,
                                              const std::string& where) {
  PacketSensorOptions options;
  options.where = where;
  if (!may_be_ouster(payload) && metadata.empty()) return recognise_sensor(payload, options);
  std::string reason;
  std::shared_ptr<const PacketSensor> fitting;
  for (const Metadata& m : metadata) {
    options.metadata = m.text;
    options.metadata_name = m.name;
    try {
      auto sensor = recognise_sensor(payload, options);
      if (!sensor) continue;
      const OusterLayout layout(parse_ouster_metadata(m.text, m.name));
      const std::uint64_t serial = layout.serial_number(payload);
      if (serial != 0 && std::to_string(serial) == layout.info().serial_number) return sensor;
      if (!fitting) fitting = std::move(sensor);
    } catch (const Error& error) {
      if (reason.empty()) reason = error.what();
    }
  }
  if (fitting) return fitting;
  options.metadata.clear();
  if (auto sensor = may_be_ouster(payload) ? nullptr : recognise_sensor(payload, options)) return sensor;
  if (!may_be_ouster(payload)) return nullptr;
  if (!reason.empty())
    throw Error("the packets are an Ouster's, whose metadata is not understood", where, reason);
  if (metadata.empty()) return recognise_sensor(payload, options);  // says that it is missing
  throw Error("the packets (" + std::to_string(payload.size()) + " bytes) do not fit the Ouster metadata",
              metadata.front().name,
              "Put the metadata of this recording beside it, or name it with --metadata.");
}

std::map<std::string, Sender> find_senders(const Capture& capture) {
  std::map<std::string, Sender> senders;
  std::size_t seen = 0;
  capture.read(0, UINT64_MAX, [&](const Datagram& datagram) {
    Sender& sender = senders[datagram.source];
    ++sender.datagrams;
    if (sender.samples.size() < kSamples)
      sender.samples.emplace(datagram.payload.size(), std::string(datagram.payload));
    return ++seen < kLookedAt;
  });
  return senders;
}

}  // namespace

Drive open_packet_capture(const std::string& path, const SourceOptions& options) {
  const auto capture = std::make_shared<const Capture>(path);
  std::map<std::string, Sender> senders = find_senders(*capture);
  const std::vector<Metadata> metadata = metadata_of(path, options.metadata);
  std::vector<std::string> known;
  std::string list, others;
  for (auto& [source, sender] : senders) {
    if (!options.topic.empty() && source.rfind(options.topic, 0) != 0) continue;
    for (auto it = sender.samples.rbegin(); it != sender.samples.rend() && !sender.sensor; ++it)
      sender.sensor = sensor_of(it->second, metadata, path + ", " + source);
    std::string sizes;
    for (const auto& [size, sample] : sender.samples)
      sizes += (sizes.empty() ? "" : ", ") + std::to_string(size);
    others += (others.empty() ? "" : "; ") + source + " (datagrams of " + sizes + " bytes)";
    if (!sender.sensor) continue;
    known.push_back(source);
    list += (list.empty() ? "" : ", ") + source + " (" + sender.sensor->name() + ")";
  }
  if (known.empty() && !options.topic.empty() && others.empty()) {
    for (const auto& [source, sender] : senders) others += (others.empty() ? "" : ", ") + source;
    throw Error("the capture has no sender with this address", options.topic, "It has: " + others + ".");
  }
  if (known.empty()) {
    const std::string damage = capture->damage();
    throw Error("the capture holds no packets of a LiDAR that is known", path,
                (damage.empty() ? "" : "It " + damage + ". ") +
                    (others.empty() ? "It has no UDP datagrams over IPv4." : "It has: " + others + ".") +
                    " Known are Velodyne VLP-16, VLP-32C, HDL-32E, VLS-128, Ouster, and Hesai 40P, 64, QT64, "
                    "XT16, XT32.");
  }
  if (known.size() > 1)
    throw Error("the capture holds packets of several sensors", path,
                "Name one with --topic ADDRESS: " + list + ".");

  const std::string source = known.front();
  const auto sensor = senders[source].sensor;
  Drive drive;
  drive.info = {stem(base_name(path)), "pcap", sensor->name(), path};
  drive.sweep_in_doubt = false;  // the sensor stamps what it fires
  const ReadPackets read_packets = [capture, source, sensor](std::uint64_t first, std::uint64_t last,
                                                             const UsePacket& use) {
    const auto is_ours = [&](const Datagram& datagram) {
      return datagram.source == source && sensor->fits(datagram.payload);
    };
    if (last == UINT64_MAX) {  // all of the file: one packet after the other
      capture->read(first, last, [&](const Datagram& datagram) {
        if (is_ours(datagram)) use(datagram.received_us, datagram.key, datagram.payload);
        return true;
      });
      return;
    }
    // A scan: others may read while it is decoded.
    std::vector<std::tuple<std::int64_t, std::uint64_t, std::string>> packets;
    capture->read(first, last, [&](const Datagram& datagram) {
      if (is_ours(datagram))
        packets.emplace_back(datagram.received_us, datagram.key, std::string(datagram.payload));
      return true;
    });
    for (const auto& [received_us, key, payload] : packets) use(received_us, key, payload);
  };
  set_packet_scans(sensor, read_packets, drive);
  if (const std::string damage = capture->damage(); !damage.empty())
    drive.warnings.push_back(path + " " + damage + ": what follows is left out");
  if (capture->cut_off() > 0)
    drive.warnings.push_back(path + ": " + std::to_string(capture->cut_off()) +
                             " packets were captured in part only or miss fragments, and are left out");
  return drive;
}

}  // namespace hp2
