#include "player/process/player_process.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/transport/channels.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kAssumedPeriodUs = 100'000;
constexpr std::int64_t kUnaskedUs = 5'000'000;
constexpr int kStopped = 130;

constexpr std::int64_t kLongestWaitUs = 10'000'000;
constexpr std::int64_t kShortWaitUs = 1'000'000;
constexpr std::size_t kMostDamageTold = 5;

// When the scans appear on the recorded clock [us]. A gap of more than kLongestWaitUs lasts kShortWaitUs: a
// clock that was set meanwhile would stop the player for years.
std::vector<std::int64_t> due_times(const ScanSource& source, std::int64_t& longest_gap_us) {
  std::vector<std::int64_t> due;
  std::int64_t before = 0;
  for (std::size_t i = 0; i < source.size(); ++i) {
    const std::int64_t here = source.utime_end(i).value_or(static_cast<std::int64_t>(i) * kAssumedPeriodUs);
    const std::int64_t step = i == 0 ? 0 : here - before;
    longest_gap_us = std::max(longest_gap_us, step);
    due.push_back(
        i == 0 ? 0 : due.back() + (step > kLongestWaitUs ? kShortWaitUs : std::max<std::int64_t>(step, 0)));
    before = here;
  }
  return due;
}

// Mean recorded time between two scans [s].
double scan_period_s(const ScanSource& source) {
  const std::size_t n = source.size();
  std::int64_t longest_gap_us = 0;
  const std::vector<std::int64_t> due = due_times(source, longest_gap_us);
  if (n < 2 || due.back() <= due.front()) return static_cast<double>(kAssumedPeriodUs) * 1e-6;
  return static_cast<double>(due.back() - due.front()) * 1e-6 / static_cast<double>(n - 1);
}

}  // namespace

PlayerProcess::PlayerProcess(Bus& bus, const ScanSource& source, const PlayerOptions& options)
    : bus_(bus),
      source_(source),
      options_(options),
      total_(static_cast<std::int64_t>(source.size())),
      endpoint_(bus),
      presence_(endpoint_, "hp2_player"),
      control_(endpoint_, "hp2_player", [this](const control_t& m, bool named) { on_command(m, named); }),
      loader_(
          [&source](std::int64_t id) {
            thread_local Scan scan;  // its memory is used for the next one
            scan = source.read(static_cast<std::size_t>(id), std::move(scan));
            check_scan_limits(scan, source.info().path + ", scan " + std::to_string(id));
            std::uint32_t crc = 0;
            ByteVector bytes = encode_scan(scan, &crc);
            return EncodedMessage(std::move(bytes), crc);
          },
          options.ahead, options.threads),
      outbox_(endpoint_, kScanTopic, [this](std::int64_t id) { return loader_.get(id); }),
      progress_(total_, scan_period_s(source)),
      stagnation_(endpoint_, presence_, options.run.give_up_after_s),
      paused_(options.start_paused) {
  endpoint_.adopt_session_from({kResumeTopic, kSubmapTopic});
  endpoint_.set_session(options.run.session_id);
  if (options.run.session_id == 0) {
    endpoint_.leave_silent_session([this] { return outbox_.heard_us() == 0; });
  }
  // The back-end offers the state to take the session up from: of one that has ended, that it has.
  endpoint_.watch_offers(kResumeTopic, [this](const offer_t& offer) {
    if (offer.ended == 0) session_ended_us_ = 0;
    if (offer.ended != 0 && session_ended_us_ == 0) session_ended_us_ = bus_.now_us();
  });
  outbox_.send_for_any_session();
  loader_.set_end(total_);
  for (const auto& warning : source.warnings()) presence_.warn(warning);
  std::int64_t longest_gap_us = 0;
  due_us_ = due_times(source, longest_gap_us);
  if (options.rate > 0 && longest_gap_us > kLongestWaitUs)
    presence_.warn("gaps of more than 10 s between scans are cut to 1 s when playing by the clock");
}

void PlayerProcess::on_command(const control_t& command, bool named) {
  switch (command.command) {
    case control_t::PAUSE:
      if (!paused_) allowed_ = options_.rate > 0 ? appeared_ : std::min(total_, registered() + 1);
      paused_ = true;
      break;
    case control_t::RESUME:
      paused_ = false;
      break;
    case control_t::STEP:
      if (!paused_) break;
      allowed_ = std::min(total_, allowed_ + std::clamp<std::int64_t>(command.argument, 1, total_));
      break;
    case control_t::STOP:
      (named ? stop_ : stop_all_) = true;
      break;
    default:
      break;
  }
}

// Scans before it need not be played any more, as the front-end has reported.
std::int64_t PlayerProcess::registered() const { return std::min(total_, outbox_.wanted_id()); }

// When scan `index` appears, on the recorded clock without its long gaps [us].
std::int64_t PlayerProcess::due(std::int64_t index) const { return due_us_[static_cast<std::size_t>(index)]; }

void PlayerProcess::report_damage() {
  const auto damaged = source_.damaged();
  for (std::size_t i = damaged_; i < std::min(damaged.size(), kMostDamageTold); ++i)
    presence_.warn(damaged[i]);
  damaged_ = damaged.size();
  if (damaged_ > 0) endpoint_.counters()["scans_damaged"] = static_cast<std::int64_t>(damaged_);
}

void PlayerProcess::turn_clock() {
  const std::int64_t now = bus_.now_us();
  if (clock_start_us_ < 0) {  // the clock starts when someone listens, at the scan that is wanted next
    if (outbox_.heard_us() == 0 || outbox_.wish_pending()) return;
    appeared_ = std::max(appeared_, registered());
    if (appeared_ >= total_) return;
    clock_start_us_ = now;
    clock_base_us_ = due(appeared_);
  }
  if (paused_) {
    clock_start_us_ += now - last_tick_us_;
    if (allowed_ > appeared_) {
      appeared_ = allowed_;
      if (appeared_ < total_) {
        clock_start_us_ = now;
        clock_base_us_ = due(appeared_);
      }
    }
    return;
  }
  const double recorded_us = static_cast<double>(now - clock_start_us_) * options_.rate;
  while (appeared_ < total_ && static_cast<double>(due(appeared_) - clock_base_us_) <= recorded_us)
    ++appeared_;
}

void PlayerProcess::offer() {
  if (options_.rate > 0) {
    outbox_.offer(0, appeared_, appeared_ == total_, offer_t::REAL_TIME);
  } else {
    const std::int64_t next = paused_ ? allowed_ : total_;
    outbox_.offer(0, next, next == total_, offer_t::LOCKSTEP);
  }
}

void PlayerProcess::report() {
  Report report;
  report.done = registered();
  report.total = total_;
  if (endpoint_.session_id() == 0) {
    report.text = "waiting for a back-end or a front-end on the bus";
  } else if (session_ended_us_ != 0) {
    report.text = "the session is complete";
  } else if (outbox_.heard_us() == 0) {
    report.text = "waiting for a front-end to ask for scans";
  } else if (paused_) {
    report.state = status_t::PAUSED;
    report.text = "paused";
  } else {
    report.state = status_t::RUNNING;
    report.text = report.done < total_ ? "playing" : "all scans are played: waiting until they are stored";
  }
  endpoint_.counters()["scans_played"] = options_.rate > 0 ? appeared_ : registered();
  report_damage();
  presence_.set(report);
  const bool waiting = report.state == status_t::WAITING;
  progress_.show(report.done, presence_.rate(),
                 waiting || paused_ || report.done == total_ ? report.text : "", bus_.now_us());
}

// The session is complete, and no front-end is there to report it: it was killed, or began after the back-end
// had ended.
bool PlayerProcess::nobody_asks() const {
  return session_ended_us_ != 0 &&
         bus_.now_us() - std::max(session_ended_us_, outbox_.heard_us()) > kUnaskedUs;
}

bool PlayerProcess::end(int status, const std::string& text) {
  exit_status_ = status;
  progress_.close(registered(), bus_.now_us());
  report_damage();
  Report report = presence_.report();
  report.state = status == 0 ? status_t::FINISHED : status_t::FAILED;
  report.text = text;
  report.done = registered();
  presence_.set(report);
  return false;
}

bool PlayerProcess::tick() {
  // A scan that cannot be read ends the drive once all before it are registered.
  loader_.rethrow_error(registered());
  if (options_.rate > 0 && endpoint_.session_id() != 0) turn_clock();
  last_tick_us_ = bus_.now_us();
  offer();
  endpoint_.poll();
  if (outbox_.done_id() >= total_) return end(0, "every scan is registered and stored");
  if (outbox_.over()) return end(0, "the front-end has ended the session");
  if (nobody_asks()) return end(0, "the session is complete");
  if (stop_ || stop_signals() > 0) return end(kStopped, "stopped");
  if (stop_all_) return end(0, "the session is ended by a command");
  report();
  // By the clock the next scan may be minutes away: the drive has a gap.
  const bool clock_runs = options_.rate > 0 && clock_start_us_ >= 0 && appeared_ < total_;
  stagnation_.tick(clock_runs, paused_);
  presence_.poll();
  return true;
}

}  // namespace hp2
