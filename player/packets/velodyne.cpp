// Velodyne VLP-16, Puck Hi-Res, VLP-32C, HDL-32E, VLS-128 (Alpha Prime): packets of 1206 bytes. 12 blocks of
// (mark, azimuth [0.01 degrees], 32 returns of distance and reflectivity), time [us in the hour], return
// mode, model.
#include <algorithm>
#include <array>
#include <cmath>

#include "player/packets/packet_stream.hpp"
#include "player/packets/velodyne_beams.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kPacketBytes = 1206, kBlocks = 12, kBlockBytes = 100, kReturns = 32;
constexpr std::size_t kTimeAt = 1200, kModeAt = 1204, kModelAt = 1205;
constexpr unsigned kDual = 0x39;

/// What sets one model apart.
struct Model {
  unsigned id;  ///< The packet's last byte.
  const char* name;
  const VelodyneBeam* beams;
  double distance_unit_m;
  double cycle_ns;    ///< From one firing of a laser to its next one.
  double firing_ns;   ///< From one laser (or group that fires together) to the next.
  std::size_t group;  ///< Lasers that fire together.
};

// Times: the manuals' firing sequences.
constexpr Model kModels[] = {{0x21, "hdl32e", kHdl32eBeams, 0.002, 46080.0, 1152.0, 1},
                             {0x22, "vlp16", kVlp16Beams, 0.002, 55296.0, 2304.0, 1},
                             {0x24, "vlp16-hires", kPuckHiResBeams, 0.002, 55296.0, 2304.0, 1},
                             {0x28, "vlp32c", kVlp32cBeams, 0.004, 55296.0, 2304.0, 2},
                             {0xa1, "vls128", kVls128Beams, 0.004, 53300.0, 2665.0, 8}};

unsigned byte_at(std::string_view payload, std::size_t at) { return static_cast<unsigned char>(payload[at]); }

/// Which 32 lasers a block has; -1 if it is no block.
int bank_of(std::string_view payload, std::size_t block) {
  switch (packet_number<std::uint16_t>(payload, block * kBlockBytes)) {
    case 0xeeff:
      return 0;
    case 0xddff:
      return 1;
    case 0xccff:
      return 2;
    case 0xbbff:
      return 3;
    default:
      return -1;
  }
}

class VelodyneFormat final : public PacketFormat {
 public:
  explicit VelodyneFormat(const Model& model) : model_(model), name_(model.name) {
    two_firings_ = model.id == 0x22 || model.id == 0x24;
    banks_ = model.id == 0xa1 ? 4 : 1;
    steps_azimuth_ = two_firings_ || model.id == 0x28;
    for (std::size_t i = 0; i < 36000; ++i) {
      const double angle = static_cast<double>(i) * M_PI / 18000.0;
      cosine_.push_back(std::cos(angle));
      sine_.push_back(std::sin(angle));
    }
  }

  const std::string& name() const override { return name_; }
  std::int64_t clock_period_ns() const override { return 3'600'000'000'000; }
  bool fits(std::string_view payload) const override {
    if (payload.size() != kPacketBytes || byte_at(payload, kModelAt) != model_.id) return false;
    for (std::size_t i = 0; i < kBlocks; ++i) {
      const int bank = bank_of(payload, i);
      if (i < used_blocks(payload) && (bank < 0 || bank >= banks_ || azimuth(payload, i) >= 36000))
        return false;
    }
    return packet_number<std::uint32_t>(payload, kTimeAt) <
           3'600'000'000U + 60'000'000U;  // a leap second and jitter
  }
  std::int64_t time_ns(std::string_view payload) const override {
    return std::int64_t{1000} * packet_number<std::uint32_t>(payload, kTimeAt);
  }

  void blocks(std::string_view payload, std::vector<PacketBlock>& out) const override {
    out.clear();
    for (std::size_t i = 0; i < used_blocks(payload); ++i)
      out.push_back({azimuth(payload, i) * 0.01,
                     static_cast<std::int64_t>(std::llround(block_time_ns(payload, i))), -1, i});
  }

  void points(std::string_view payload, const PacketBlock& block, std::int64_t packet_ns,
              PacketPoints& out) const override {
    const std::size_t b = block.index;
    const bool dual = is_dual(payload);
    const double rate = degrees_per_ns(payload);
    const int bank = bank_of(payload, b);
    // All blocks of a firing sequence may carry the azimuth of its first laser.
    const std::size_t first = first_of_sequence(payload, b);
    const bool shared = azimuth(payload, first) == azimuth(payload, b);
    const double azimuth_from_ns = shared ? block_time_ns(payload, first) : block_time_ns(payload, b);
    for (std::size_t k = 0; k < kReturns; ++k) {
      const std::size_t at = b * kBlockBytes + 4 + 3 * k;
      const unsigned distance = packet_number<std::uint16_t>(payload, at);
      if (distance == 0) continue;
      if (dual && is_second(b) &&
          distance == packet_number<std::uint16_t>(payload, twin(payload, b) + 4 + 3 * k))
        continue;
      const std::size_t laser = two_firings_ ? k % 16 : k + kReturns * static_cast<std::size_t>(bank);
      const double t = laser_time_ns(payload, b, k);
      const VelodyneBeam& beam = model_.beams[laser];
      auto index = std::llround(steps_azimuth_ ? azimuth_by_steps(payload, b, k, beam)
                                               : azimuth(payload, b) + 100.0 * (rate * (t - azimuth_from_ns) +
                                                                                beam.azimuth_deg)) %
                   36000;
      if (index < 0) index += 36000;
      const double r = distance * model_.distance_unit_m;
      const double elevation = beam.elevation_deg * M_PI / 180.0;
      const double flat = r * std::cos(elevation);
      out.add(flat * cosine_[static_cast<std::size_t>(index)], -flat * sine_[static_cast<std::size_t>(index)],
              r * std::sin(elevation), byte_at(payload, at + 2), packet_ns + std::llround(t));
    }
  }

 private:
  static bool is_dual(std::string_view payload) { return byte_at(payload, kModeAt) == kDual; }
  static double azimuth(std::string_view payload, std::size_t block) {
    return packet_number<std::uint16_t>(payload, block * kBlockBytes + 2);
  }
  std::size_t used_blocks(std::string_view payload) const {
    return banks_ == 4 && is_dual(payload) ? 8 : kBlocks;
  }
  /// Dual returns: which blocks repeat the firing of the one before.
  static bool is_second(std::size_t block) { return block % 2 == 1; }
  static std::size_t twin(std::string_view, std::size_t block) { return (block - 1) * kBlockBytes; }

  /// Number of the firing sequence in the packet that a block begins with.
  std::size_t sequence_of(std::string_view payload, std::size_t block) const {
    const std::size_t n = is_dual(payload) ? block / 2 : block;
    return two_firings_ ? 2 * n : n / static_cast<std::size_t>(banks_);
  }
  std::size_t first_of_sequence(std::string_view payload, std::size_t block) const {
    const std::size_t blocks = static_cast<std::size_t>(banks_) * (is_dual(payload) ? 2 : 1);
    return block / blocks * blocks;
  }
  /// Time of a block's return after the packet's time.
  double laser_time_ns(std::string_view payload, std::size_t block, std::size_t k) const {
    const std::size_t sequence = sequence_of(payload, block);
    if (two_firings_)
      return static_cast<double>(sequence + k / 16) * model_.cycle_ns +
             static_cast<double>(k % 16) * model_.firing_ns;
    const std::size_t laser = k + kReturns * static_cast<std::size_t>(std::max(bank_of(payload, block), 0));
    std::size_t slot = laser / model_.group;
    double start = 0.0;
    if (banks_ == 4) {
      slot += slot / 8;  // a pause after eight groups
      start = -8700.0;   // the packet's time is that of the fourth group or so
    }
    return start + static_cast<double>(sequence) * model_.cycle_ns +
           static_cast<double>(slot) * model_.firing_ns;
  }
  double block_time_ns(std::string_view payload, std::size_t block) const {
    return laser_time_ns(payload, block, 0);
  }

  /// Azimuth of a return [0.01 degrees] of the models with one block a firing, interpolated to the next
  /// block's as the drivers in use do it, in their arithmetic: what they decode is what recordings are
  /// compared with. They leave the packet's last block as it is, and let the VLP-32C's lasers fire one by
  /// one.
  float azimuth_by_steps(std::string_view payload, std::size_t block, std::size_t k,
                         const VelodyneBeam& beam) const {
    // Of dual returns, the second ones stand at the next firing's azimuth there.
    const bool second = is_dual(payload) && is_second(block);
    const std::size_t next = block + (is_dual(payload) && !second ? 2 : 1);
    const auto there = static_cast<float>(azimuth(payload, std::min(next, kBlocks - 1)));
    const float here = second ? there : static_cast<float>(azimuth(payload, block));
    const float step = next < kBlocks && !second ? std::fmod(36000.0F + there - here, 36000.0F) : 0.0F;
    const auto laser = static_cast<float>(two_firings_ ? k % 16 : k), firing = static_cast<float>(k / 16);
    const auto rotation = static_cast<float>(-beam.azimuth_deg * M_PI / 180.0);
    const float turned = two_firings_ ? here + (step * ((laser * 2.304F) + (firing * 55.296F)) / 110.592F)
                                      : here + (step * 2.304F / 55.296F * laser);
    return static_cast<float>(turned - rotation * 180.0 / M_PI * 100);
  }

  /// Speed of the turn, from the packet's first and last firing sequence.
  double degrees_per_ns(std::string_view payload) const {
    const std::size_t last = first_of_sequence(payload, used_blocks(payload) - 1);
    const double in = block_time_ns(payload, last) - block_time_ns(payload, 0);
    double by = azimuth(payload, last) - azimuth(payload, 0);
    if (by < -18000.0) by += 36000.0;
    if (by > 18000.0) by -= 36000.0;
    return in > 0.0 ? 0.01 * by / in : 0.0;
  }

  const Model model_;
  const std::string name_;
  bool two_firings_ = false;    ///< 16 lasers: a block has two firings of each.
  bool steps_azimuth_ = false;  ///< See azimuth_by_steps().
  int banks_ = 1;               ///< Blocks a firing sequence.
  std::vector<double> cosine_, sine_;
};

}  // namespace

std::shared_ptr<const PacketSensor> recognise_velodyne(std::string_view payload) {
  if (payload.size() != kPacketBytes) return nullptr;
  for (const Model& model : kModels) {
    if (byte_at(payload, kModelAt) != model.id) continue;
    auto format = std::make_shared<VelodyneFormat>(model);
    if (format->fits(payload)) return make_sensor(std::move(format));
  }
  return nullptr;
}

}  // namespace hp2
