#include "player/packets/packet_stream.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <functional>
#include <limits>
#include <optional>
#include <utility>

namespace hp2 {
namespace {

constexpr std::size_t kWindow = 16;      // packets that wait for one that is late
constexpr std::size_t kRemembered = 64;  // packets that a doubled one is looked for among
constexpr std::int64_t kStep_ns =
    500'000'000;  // a longer step of the sensor's clock is a gap or another clock
constexpr std::int64_t kSynced_ns = 2'000'000'000;  // a clock this near to the receiver's is right

struct Held {
  std::int64_t time_ns = 0;  ///< The sensor's clock, unrolled.
  std::int64_t received_us = 0;
  std::uint64_t key = 0;
  std::size_t hash = 0;
  std::string payload;
};

double turned_by(double from_deg, double to_deg) {
  double d = std::fmod(to_deg - from_deg, 360.0);
  if (d > 180.0) d -= 360.0;
  if (d <= -180.0) d += 360.0;
  return d;
}

class StreamDecoder final : public PacketDecoder {
 public:
  StreamDecoder(std::shared_ptr<const PacketFormat> format, bool points)
      : format_(std::move(format)), points_(points) {}

  const PacketCounts& counts() const override { return counts_; }

  void take(std::int64_t received_us, std::uint64_t key, std::string_view payload,
            std::vector<Turn>& turns) override {
    ++counts_.packets;
    if (!format_->fits(payload)) {
      ++counts_.refused;
      return;
    }
    Held packet;
    packet.received_us = received_us;
    packet.key = key;
    packet.hash = std::hash<std::string_view>()(payload);
    if (std::find(recent_.begin(), recent_.end(), packet.hash) != recent_.end()) {
      ++counts_.doubled;
      return;
    }
    recent_.push_back(packet.hash);
    if (recent_.size() > kRemembered) recent_.pop_front();
    packet.time_ns = unrolled(format_->time_ns(payload));
    packet.payload = std::string(payload);
    if (!newest_ || std::abs(packet.time_ns - *newest_) < kStep_ns) {
      if (suspect_) {  // one impossible time between good ones
        ++counts_.refused;
        suspect_.reset();
      }
      return hold(std::move(packet), turns);
    }
    // The time jumps. The next packet shows whether the clock jumped, or whether this one packet is wrong.
    if (suspect_ && std::abs(packet.time_ns - suspect_->time_ns) < kStep_ns) {
      flush(turns);
      newest_.reset();
      last_released_.reset();
      const Held first = *std::exchange(suspect_, std::nullopt);
      hold(first, turns);
      return hold(std::move(packet), turns);
    }
    if (suspect_) ++counts_.refused;
    suspect_ = std::move(packet);
  }

  void finish(std::vector<Turn>& turns) override {
    if (suspect_) ++counts_.refused;
    suspect_.reset();
    flush(turns);
  }

 private:
  /// The sensor's time, continued where its clock starts again.
  std::int64_t unrolled(std::int64_t time_ns) const {
    const std::int64_t period = format_->clock_period_ns();
    if (period == 0 || !newest_) return time_ns;
    std::int64_t step = (time_ns - *newest_) % period;
    if (step > period / 2) step -= period;
    if (step < -period / 2) step += period;
    return *newest_ + step;
  }

  void hold(Held packet, std::vector<Turn>& turns) {
    if (last_released_ && packet.time_ns < *last_released_) {
      ++counts_.late;
      return;
    }
    if (newest_ && packet.time_ns < *newest_) ++counts_.reordered;
    newest_ = newest_ ? std::max(*newest_, packet.time_ns) : packet.time_ns;
    const auto place = std::upper_bound(held_.begin(), held_.end(), packet,
                                        [](const Held& a, const Held& b) { return a.time_ns < b.time_ns; });
    held_.insert(place, std::move(packet));
    while (held_.size() > kWindow) release(turns);
  }

  void release(std::vector<Turn>& turns) {
    const Held packet = std::move(held_.front());
    held_.pop_front();
    use(packet, turns);
    last_released_ = packet.time_ns;
  }

  /// Hands on all that is held and ends the turn.
  void flush(std::vector<Turn>& turns) {
    while (!held_.empty()) release(turns);
    end_turn(turns, std::nullopt);
    offset_us_.reset();
    previous_.reset();
  }

  void use(const Held& packet, std::vector<Turn>& turns) {
    if (!offset_us_) set_clock(packet);
    format_->blocks(packet.payload, blocks_);
    if (blocks_.empty()) return;
    count_lost(packet);
    measure_rate();
    for (const PacketBlock& block : blocks_) {
      const std::int64_t t = packet.time_ns + block.time_ns;
      const Seam seam = previous_ ? seam_before(block, t) : Seam::kGap;
      if (seam == Seam::kGap) {
        end_turn(turns, std::nullopt);
      } else if (seam == Seam::kCut) {
        turn_.last_key = std::max(turn_.last_key, packet.key);  // decoding must see the cut, too
        end_turn(turns, t);
      }
      if (!open_) begin_turn(packet, t, seam == Seam::kCut);
      if (seam == Seam::kNone) add_covered(block, t);
      turn_.first_key = std::min(turn_.first_key, packet.key);
      turn_.last_key = std::max(turn_.last_key, packet.key);
      if (points_) format_->points(packet.payload, block, packet.time_ns, found_);
      previous_ = block;
      previous_t_ = t;
    }
    previous_key_ = packet.key;
  }

  enum class Seam { kNone, kCut, kGap };  // between two blocks

  /// How fast and in which direction the sensor turns, and how much of its time a block takes.
  void measure_rate() {
    if (blocks_.size() < 2) return;
    const double by = turned_by(blocks_.front().azimuth_deg, blocks_.back().azimuth_deg);
    const std::int64_t in = blocks_.back().time_ns - blocks_.front().time_ns;
    if (by == 0.0 || in <= 0) return;
    turning_ = by < 0.0 ? -1.0 : 1.0;
    rate_ = std::abs(by) / static_cast<double>(in);
    block_ns_ = in / static_cast<std::int64_t>(blocks_.size() - 1);
  }

  Seam seam_before(const PacketBlock& block, std::int64_t t) const {
    const double turned = rate_ * static_cast<double>(t - previous_t_);
    if (turned > 300.0) return Seam::kGap;
    if (block.turn >= 0) return block.turn != previous_->turn ? Seam::kCut : Seam::kNone;
    const double before = previous_->azimuth_deg * turning_, now = block.azimuth_deg * turning_;
    const bool forward = turned > 180.0 || turned_by(before, now) > 0.0;
    return forward && now < before ? Seam::kCut : Seam::kNone;
  }

  void add_covered(const PacketBlock& block, std::int64_t t) {
    const double by = turned_by(previous_->azimuth_deg, block.azimuth_deg) * turning_;
    const bool missing = static_cast<double>(t - previous_t_) > 3.5 * static_cast<double>(block_ns_);
    turn_.covered_deg += missing ? rate_ * static_cast<double>(block_ns_) : std::max(by, 0.0);
  }

  void count_lost(const Held& packet) {
    const bool all_round = format_->window_deg() > 359.0;  // else there are gaps in every turn
    if (all_round && last_released_ && packet.time_ns > *last_released_) {
      const std::int64_t step = packet.time_ns - *last_released_;
      if (packet_step_ == 0 || step < packet_step_) packet_step_ = step;
      if (step > packet_step_ * 3 / 2)
        counts_.lost += static_cast<std::uint64_t>((step + packet_step_ / 2) / packet_step_ - 1);
    }
  }

  /// The difference of the sensor's clock and ours: none where they agree, else the receiver's clock counts.
  void set_clock(const Held& packet) {
    const std::int64_t received_ns = packet.received_us * 1000;
    const std::int64_t period = format_->clock_period_ns();
    std::int64_t off = received_ns - packet.time_ns;
    std::int64_t whole = 0;
    if (period > 0) {
      const auto periods = std::llround(static_cast<double>(off) / static_cast<double>(period));
      whole = periods * period;
      off -= whole;
    }
    if (packet.received_us <= 0) off = whole = 0;
    offset_us_ = (std::abs(off) < kSynced_ns ? whole : whole + off) / 1000;
  }

  void begin_turn(const Held& packet, std::int64_t t, bool follows) {
    open_ = true;
    turn_ = Turn{};
    turn_.whole = follows;
    turn_.start_ns = t;
    turn_.utime = t / 1000 + *offset_us_;
    turn_.first_key = previous_ ? std::min(previous_key_, packet.key) : packet.key;
    turn_.last_key = packet.key;
  }

  /// @param end_ns where the next turn follows without a gap
  void end_turn(std::vector<Turn>& turns, std::optional<std::int64_t> end_ns) {
    if (!open_) return;
    open_ = false;
    turn_.whole = turn_.whole && end_ns.has_value();
    const std::int64_t end = std::max(end_ns.value_or(previous_t_ + block_ns_), turn_.start_ns);
    turn_.duration_us = std::max<std::int64_t>((end - turn_.start_ns) / 1000, 1);
    turn_.covered_deg += rate_ * static_cast<double>(block_ns_);
    if (points_) {
      Scan& scan = turn_.scan;
      scan.time.resize(found_.time_ns.size());
      const double length = std::max(1e3 * static_cast<double>(turn_.duration_us), 1.0);
      for (std::size_t i = 0; i < scan.time.size(); ++i)
        scan.time[i] = static_cast<float>(
            std::clamp(static_cast<double>(found_.time_ns[i] - turn_.start_ns) / length, 0.0, 1.0));
      scan.x = std::move(found_.x);
      scan.y = std::move(found_.y);
      scan.z = std::move(found_.z);
      scan.intensity = std::move(found_.intensity);
      found_ = {};
    }
    turns.push_back(std::move(turn_));
  }

  const std::shared_ptr<const PacketFormat> format_;
  const bool points_;
  PacketCounts counts_;
  // Packets, until they are in order.
  std::deque<std::size_t> recent_;
  std::deque<Held> held_;
  std::optional<Held> suspect_;
  std::optional<std::int64_t> newest_, last_released_;
  std::int64_t packet_step_ = 0;
  std::optional<std::int64_t> offset_us_;
  // The turn that is open.
  bool open_ = false;
  Turn turn_;
  PacketPoints found_;
  double rate_ = 0.0;          ///< [degrees/ns]
  double turning_ = 1.0;       ///< 1 if azimuths rise, -1 if they fall.
  std::int64_t block_ns_ = 0;  ///< Time a block takes.
  std::optional<PacketBlock> previous_;
  std::int64_t previous_t_ = 0;
  std::uint64_t previous_key_ = 0;
  std::vector<PacketBlock> blocks_;
};

class StreamSensor final : public PacketSensor {
 public:
  explicit StreamSensor(std::shared_ptr<const PacketFormat> format) : format_(std::move(format)) {}
  const std::string& name() const override { return format_->name(); }
  double window_deg() const override { return format_->window_deg(); }
  bool fits(std::string_view payload) const override { return format_->fits(payload); }
  std::unique_ptr<PacketDecoder> make_decoder(bool points) const override {
    return std::make_unique<StreamDecoder>(format_, points);
  }

 private:
  const std::shared_ptr<const PacketFormat> format_;
};

}  // namespace

std::shared_ptr<const PacketSensor> make_sensor(std::shared_ptr<const PacketFormat> format) {
  return std::make_shared<StreamSensor>(std::move(format));
}

std::shared_ptr<const PacketSensor> recognise_sensor(std::string_view payload,
                                                     const PacketSensorOptions& options) {
  if (auto sensor = recognise_velodyne(payload)) return sensor;
  if (auto sensor = recognise_hesai(payload)) return sensor;
  return recognise_ouster(payload, options);
}

}  // namespace hp2
