// From the index of a stream's turns to a drive.
#include <algorithm>
#include <limits>
#include <map>
#include <utility>

#include "common/error.hpp"
#include "player/packets/packet_decoder.hpp"

namespace hp2 {
namespace {

/// Turns that are scans: cut at both ends and at least half there, or nearly whole without a neighbour.
std::vector<Turn> whole_turns(std::vector<Turn> turns, double window_deg, const PacketCounts& counts,
                              Drive& drive) {
  std::vector<double> covered;
  for (const Turn& turn : turns)
    if (turn.whole) covered.push_back(turn.covered_deg);
  double typical = window_deg;
  if (covered.size() > 2) {
    std::nth_element(covered.begin(), covered.begin() + static_cast<std::ptrdiff_t>(covered.size() / 2),
                     covered.end());
    typical = std::min(typical, covered[covered.size() / 2]);
  }
  std::vector<Turn> kept;
  std::size_t broken = 0, incomplete = 0;
  for (std::size_t i = 0; i < turns.size(); ++i) {
    Turn& turn = turns[i];
    const double share = turn.covered_deg / typical;
    if (share < (turn.whole ? 0.5 : 0.99)) {
      broken += i > 0 && i + 1 < turns.size() ? 1 : 0;  // those at the ends are expected
      continue;
    }
    incomplete += share < 0.99 ? 1 : 0;
    if (!kept.empty() && turn.utime <= kept.back().utime) {  // the sensor's clock was set back
      ++broken;
      continue;
    }
    kept.push_back(std::move(turn));
  }
  const auto note = [&](std::uint64_t n, const std::string& what) {
    if (n > 0) drive.warnings.push_back(drive.info.path + ": " + std::to_string(n) + " " + what);
  };
  note(counts.lost, "packets are missing");
  note(counts.doubled, "packets came twice and are taken once");
  note(counts.reordered, "packets came out of order and were sorted");
  note(counts.late, "packets came too late to be sorted and are left out");
  note(counts.refused, "packets are damaged or have an impossible time and are left out");
  note(incomplete, "turns of the sensor are incomplete and are used as they are");
  note(broken, "turns of which less than half was received are left out");
  return kept;
}

}  // namespace

void set_packet_scans(std::shared_ptr<const PacketSensor> sensor, ReadPackets read_packets, Drive& drive) {
  std::vector<Turn> all;
  const auto indexer = sensor->make_decoder(false);
  read_packets(0, std::numeric_limits<std::uint64_t>::max(),
               [&](std::int64_t received_us, std::uint64_t key, std::string_view payload) {
                 indexer->take(received_us, key, payload, all);
               });
  indexer->finish(all);
  const std::size_t parts = all.size();
  const auto turns = std::make_shared<const std::vector<Turn>>(
      whole_turns(std::move(all), sensor->window_deg(), indexer->counts(), drive));
  if (turns->empty())
    throw Error("the packets of " + sensor->name() + " make no whole turn (" +
                    std::to_string(indexer->counts().packets) + " packets, " + std::to_string(parts) +
                    " parts of turns)",
                drive.info.path, "Record for at least two turns of the sensor.");
  drive.info.sensor = sensor->name();
  for (std::size_t i = 0; i < turns->size(); ++i)
    drive.scans.push_back(
        {drive.info.path, (*turns)[i].utime, (*turns)[i].duration_us, static_cast<std::int64_t>(i)});
  drive.decode = [sensor, turns, read = std::move(read_packets)](const DriveScan& entry, Scan& scan) {
    const Turn& wanted = (*turns)[static_cast<std::size_t>(entry.key)];
    const auto decoder = sensor->make_decoder(true);
    std::vector<Turn> found;
    read(wanted.first_key, wanted.last_key,
         [&](std::int64_t received_us, std::uint64_t key, std::string_view payload) {
           decoder->take(received_us, key, payload, found);
         });
    decoder->finish(found);
    const auto it = std::find_if(found.begin(), found.end(),
                                 [&](const Turn& turn) { return turn.start_ns == wanted.start_ns; });
    if (it == found.end())
      throw Error("the packets of a scan are no longer there", entry.path,
                  "Do not change the file while it is read.");
    std::swap(scan.x, it->scan.x);
    std::swap(scan.y, it->scan.y);
    std::swap(scan.z, it->scan.z);
    std::swap(scan.intensity, it->scan.intensity);
    std::swap(scan.time, it->scan.time);
  };
}

}  // namespace hp2
