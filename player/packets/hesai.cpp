// Hesai Pandar40P, Pandar64, PandarQT64, PandarXT-16 and XT-32: blocks of (azimuth [0.01 degrees], returns of
// distance and reflectivity), then a tail with return mode, date and time.
#include <cmath>
#include <ctime>

#include "player/packets/hesai_beams.hpp"
#include "player/packets/packet_stream.hpp"

namespace hp2 {
namespace {

// Firing of each channel after its block [ns], as the manuals give it.
constexpr int kTimes40p[] = {-42220, -28470, -16040, -3620,  -45490, -31740, -47460, -54670, -20620, -33710,
                             -40910, -8190,  -20620, -27160, -50730, -8190,  -14740, -36980, -45490, -52700,
                             -23890, -31740, -38950, -11470, -18650, -25190, -48760, -6230,  -12770, -35010,
                             -21920, -9500,  -43520, -29770, -17350, -4920,  -42220, -28470, -16040, -3620};
constexpr int kTimes64[] = {
    -23180, -21876, -20572, -19268, -17964, -16660, -11444, -46796, -7532,  -36956, -50732, -54668, -40892,
    -44828, -31052, -34988, -48764, -52700, -38924, -42860, -29084, -33020, -46796, -25148, -36956, -50732,
    -27116, -40892, -44828, -31052, -34988, -48764, -25148, -38924, -42860, -29084, -33020, -52700, -6228,
    -54668, -15356, -27116, -10140, -23180, -4924,  -21876, -14052, -17964, -8836,  -19268, -3620,  -20572,
    -12748, -16660, -7532,  -11444, -6228,  -15356, -10140, -4924,  -3620,  -14052, -8836,  -12748};
constexpr int kTimesQt64[] = {
    12310,  14370,  16430,  18490,  20540,  22600,  24660,  26710,  29160,  31220,  33280,  35340,  37390,
    39450,  41500,  43560,  46610,  48670,  50730,  52780,  54840,  56900,  58950,  61010,  63450,  65520,
    67580,  69630,  71690,  73740,  75800,  77860,  80900,  82970,  85020,  87080,  89140,  91190,  93250,
    95300,  97750,  99820,  101870, 103930, 105980, 108040, 110100, 112150, 115200, 117260, 119320, 121380,
    123430, 125490, 127540, 129600, 132050, 134110, 136170, 138220, 140280, 142340, 144390, 146450};

/// What sets one model apart.
struct Model {
  const char* name;
  const HesaiBeam* beams;
  std::size_t channels, blocks;
  std::size_t header;        ///< Bytes before the first block.
  std::size_t block_header;  ///< Bytes of a block before its returns; the azimuth is the last two.
  std::size_t unit;          ///< Bytes a return.
  std::size_t tail;  ///< Bytes after the last block, up to which the number of the packet is optional.
  std::size_t mode_at, date_at, micros_at;  ///< In the tail.
  int year_zero;
  const int* times;  ///< Of the channels; null: `channel_ns` apart, from 368 ns on.
  int channel_ns;
  double block_ns, last_block_ns;  ///< Between blocks; of the last block after the packet's time.
  bool counts_down;                ///< Blocks are timed from the last one backwards, else from the first one.
};

constexpr Model kModels[] = {
    {"hesai 40p", kPandar40pBeams, 40, 10, 0, 4, 3, 22, 14, 16, 10, 2000, kTimes40p, 0, 55560.0, -28580.0,
     true},
    {"hesai 64", kPandar64Beams, 64, 6, 8, 2, 3, 22, 14, 16, 10, 2000, kTimes64, 0, 55560.0, -42580.0, true},
    {"hesai qt64", kPandarQt64Beams, 64, 4, 12, 2, 4, 24, 16, 18, 12, 1900, kTimesQt64, 0, 500000.0 / 3.0,
     25710.0, false},
    {"hesai xt16", kPandarXt16Beams, 16, 8, 12, 2, 4, 24, 10, 13, 19, 1900, nullptr, 3024, 50000.0, 5632.0,
     true},
    {"hesai xt32", kPandarXt32Beams, 32, 8, 12, 2, 4, 24, 10, 13, 19, 1900, nullptr, 1512, 50000.0, 5632.0,
     true}};

unsigned byte_at(std::string_view payload, std::size_t at) { return static_cast<unsigned char>(payload[at]); }

class HesaiFormat final : public PacketFormat {
 public:
  explicit HesaiFormat(const Model& model) : model_(model), name_(model.name) {
    block_bytes_ = model.block_header + model.channels * model.unit;
    tail_at_ = model.header + model.blocks * block_bytes_;
  }

  const std::string& name() const override { return name_; }

  bool fits(std::string_view payload) const override {
    // The packet's number and, for safety, a signature may follow the tail.
    if (payload.size() < tail_at_ + model_.tail || payload.size() > tail_at_ + model_.tail + 36) return false;
    if (model_.header == 0) {
      for (std::size_t b = 0; b < model_.blocks; ++b)
        if (byte_at(payload, b * block_bytes_) != 0xff || byte_at(payload, b * block_bytes_ + 1) != 0xee)
          return false;
    } else {
      const std::size_t counts_at = model_.header == 8 ? 2 : 6;
      if (byte_at(payload, 0) != 0xee || byte_at(payload, 1) != 0xff ||
          byte_at(payload, counts_at) != model_.channels || byte_at(payload, counts_at + 1) != model_.blocks)
        return false;
    }
    for (std::size_t b = 0; b < model_.blocks; ++b)
      if (azimuth(payload, b) >= 36000) return false;
    const unsigned mode = byte_at(payload, tail_at_ + model_.mode_at);
    return mode >= 0x33 && mode <= 0x3e && micros(payload) < 2'000'000 &&
           std::abs(date_s(payload)) < kMostPacketTime_ns / 1'000'000'000;
  }

  std::int64_t time_ns(std::string_view payload) const override {
    return (date_s(payload) * 1'000'000 + micros(payload)) * 1000;
  }

  void blocks(std::string_view payload, std::vector<PacketBlock>& out) const override {
    out.clear();
    for (std::size_t b = 0; b < model_.blocks; ++b)
      out.push_back({azimuth(payload, b) * 0.01, std::llround(block_ns(payload, b)), -1, b});
  }

  void points(std::string_view payload, const PacketBlock& block, std::int64_t packet_ns,
              PacketPoints& out) const override {
    const double unit_m = distance_unit_m(payload);
    const std::size_t returns = returns_of(payload);
    const std::size_t b = block.index;
    const bool last_return = b % returns == returns - 1;
    for (std::size_t c = 0; c < model_.channels; ++c) {
      const unsigned distance = packet_number<std::uint16_t>(payload, unit_at(b, c));
      if (distance == 0) continue;
      bool doubled = false;  // of several equal returns the last one is taken
      for (std::size_t other = b + 1; !last_return && other < model_.blocks && other % returns != 0; ++other)
        doubled = doubled || packet_number<std::uint16_t>(payload, unit_at(other, c)) == distance;
      if (doubled) continue;
      const HesaiBeam& beam = model_.beams[c];
      const double r = distance * unit_m;
      const double elevation = beam.elevation_deg * M_PI / 180.0;
      const double heading = (0.01 * azimuth(payload, b) + beam.azimuth_deg) * M_PI / 180.0;
      const double flat = r * std::cos(elevation);
      out.add(flat * std::sin(heading), flat * std::cos(heading), r * std::sin(elevation),
              byte_at(payload, unit_at(b, c) + 2),
              packet_ns + std::llround(block_ns(payload, b)) + channel_ns(c));
    }
  }

 private:
  /// Whole seconds of the packet's date, since 1970.
  std::int64_t date_s(std::string_view payload) const {
    std::tm date{};
    const std::size_t at = tail_at_ + model_.date_at;
    // Models that count from 2000 have firmware that counts from 1900.
    const auto year = static_cast<int>(byte_at(payload, at));
    date.tm_year = year >= 100 ? year : year + model_.year_zero - 1900;
    date.tm_mon = static_cast<int>(byte_at(payload, at + 1)) - 1;
    date.tm_mday = static_cast<int>(byte_at(payload, at + 2));
    date.tm_hour = static_cast<int>(byte_at(payload, at + 3));
    date.tm_min = static_cast<int>(byte_at(payload, at + 4));
    date.tm_sec = static_cast<int>(byte_at(payload, at + 5));
    return ::timegm(&date);
  }

  std::size_t unit_at(std::size_t block, std::size_t channel) const {
    return model_.header + block * block_bytes_ + model_.block_header + channel * model_.unit;
  }
  unsigned azimuth(std::string_view payload, std::size_t block) const {
    return packet_number<std::uint16_t>(payload,
                                        model_.header + block * block_bytes_ + model_.block_header - 2);
  }
  std::int64_t micros(std::string_view payload) const {
    return packet_number<std::uint32_t>(payload, tail_at_ + model_.micros_at);
  }
  double distance_unit_m(std::string_view payload) const {
    if (model_.header == 0) return 0.004;
    const unsigned unit = byte_at(payload, model_.header == 8 ? 5 : 9);
    return 0.001 * (unit == 0 ? 4 : unit);
  }
  /// Blocks that share a firing.
  std::size_t returns_of(std::string_view payload) const {
    const unsigned mode = byte_at(payload, tail_at_ + model_.mode_at);
    if (mode == 0x3d) return 3;
    return mode >= 0x39 ? 2 : 1;
  }
  double block_ns(std::string_view payload, std::size_t block) const {
    const std::size_t counted = model_.counts_down ? model_.blocks - 1 - block : block;
    const std::size_t firings = counted / returns_of(payload);
    const double after_ns = model_.block_ns * static_cast<double>(firings);
    return model_.last_block_ns + (model_.counts_down ? -after_ns : after_ns);
  }
  int channel_ns(std::size_t channel) const {
    return model_.times ? model_.times[channel] : 368 + model_.channel_ns * static_cast<int>(channel);
  }

  const Model model_;
  const std::string name_;
  std::size_t block_bytes_ = 0, tail_at_ = 0;
};

}  // namespace

std::shared_ptr<const PacketSensor> recognise_hesai(std::string_view payload) {
  for (const Model& model : kModels) {
    auto format = std::make_shared<HesaiFormat>(model);
    if (format->fits(payload)) return make_sensor(std::move(format));
  }
  return nullptr;
}

}  // namespace hp2
