#include "frontend/process/frontend_process.hpp"

#include <algorithm>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/error.hpp"
#include "common/transport/channels.hpp"
#include "frontend/process/odometry_message.hpp"

namespace hp2 {
namespace {

constexpr int kInWorker = 8;  // scans that are decoded or wait for it while one is registered
constexpr std::int64_t kNothing = 0, kEverything = std::int64_t{1} << 62;
constexpr std::int64_t kListenForTwinUs = 1'100'000;
constexpr std::int64_t kBehindPatienceUs = 2'000'000, kLingerUs = 3'000'000;
const char* const kBegunCounter = "session_begun";  // 1 from the moment on that scans may be registered

}  // namespace

FrontendProcess::FrontendProcess(LcmBus& bus, const FrontendConfig& config,
                                 const FrontendProcessOptions& options)
    : bus_(bus),
      options_(options),
      endpoint_(bus),
      presence_(endpoint_, "hp2_frontend"),
      control_(endpoint_, "hp2_frontend", [this](const control_t& m, bool named) { on_command(m, named); }),
      resume_(endpoint_, {kResumeTopic, Inbox::Order::kLatest}, [this](const Delivery& d) { on_resume(d); }),
      scans_(endpoint_, {kScanTopic, Inbox::Order::kAll, 4, kMaxScanBytes, true},
             [this](Delivery d) { on_scan(std::move(d)); }),
      submaps_(endpoint_, !options.standalone),
      live_(endpoint_, options.live_backlog, [this](const std::string& text) { presence_.warn(text); }),
      worker_(config, options.threads,
              [this](RegistrationEvent event) {
                bus_.post([this, e = std::make_shared<RegistrationEvent>(std::move(event))] {
                  on_event(std::move(*e));
                });
              }),
      stagnation_(endpoint_, presence_, options.run.give_up_after_s),
      started_us_(bus.now_us()) {
  for (const char* name : {"scans_registered", "scans_skipped", "submaps_cut"})
    endpoint_.counters()[name] = 0;
  scans_.set_limit(kNothing);
  scans_.set_silent(true);
  scans_.on_unasked([this](const Delivery& d) { live_.take(d.bytes->data(), d.bytes->size(), d.sender_id); });
  if (options_.standalone) {
    endpoint_.set_session(random_id());
  } else {
    endpoint_.adopt_session_from({kResumeTopic});
    endpoint_.set_session(options_.run.session_id);
    if (options_.run.session_id == 0) {
      endpoint_.leave_silent_session([this] { return state_ == State::kWaiting; });
    }
  }
  resume_.set_limit(kNothing);
}

void FrontendProcess::on_command(const control_t& command, bool named) {
  stop_ = stop_ || command.command == control_t::STOP;
  // The player holds back scans for everybody; the front-end itself pauses only when it is named.
  if (named && (command.command == control_t::PAUSE || command.command == control_t::RESUME)) {
    paused_ = command.command == control_t::PAUSE;
    worker_.pause(paused_);
  }
}

// Of two front-ends the one that has not begun yet leaves; if that does not tell them apart, the one with the
// larger number. Both come to the same verdict.
void FrontendProcess::check_twin() const {
  // Without a session nobody is anybody's twin; and one STATUS alone may be anybody's.
  if (endpoint_.session_id() == 0) return;
  const Peer* twin = nullptr;
  for (const Peer* peer : presence_.all_live("hp2_frontend")) {
    if (peer->established()) twin = peer;
  }
  if (twin == nullptr) return;
  const bool begun = state_ != State::kWaiting;
  bool twin_begun = false;
  for (const auto& c : twin->status.counters)
    twin_begun = twin_begun || (c.name == kBegunCounter && c.value != 0);
  if (begun != twin_begun ? begun : endpoint_.sender_id() < twin->status.sender_id) return;
  throw Error("another front-end runs this session already",
              "process " + std::to_string(twin->status.pid) + " on " + twin->status.host,
              "Stop that one first; two front-ends cannot share a session.");
}

void FrontendProcess::on_resume(const Delivery& delivery) {
  resume_t m;
  if (!safe_decode(delivery.bytes->data(), delivery.bytes->size(), m) ||
      m.session_id != endpoint_.session_id() || m.next_submap_id < 0 || m.next_sequence < 0) {
    return endpoint_.reject(chunk_channel(kResumeTopic), "not a valid resume_t");
  }
  resume_.set_limit(kNothing);
  if (m.ended) {
    spdlog::info("session {} is complete already", m.session_id);
    next_sequence_ = m.next_sequence;
    submaps_.begin(m.next_submap_id, m.next_sequence, true);
    state_ = State::kOver;
    scans_.set_silent(false);
    return;
  }
  begin(m.next_submap_id, m.next_sequence, m.state);
}

void FrontendProcess::begin(std::int64_t next_submap, std::int64_t next_sequence,
                            const std::vector<std::uint8_t>& state) {
  generation_ = worker_.begin(endpoint_.session_id(), state);
  in_worker_ = 0;
  next_sequence_ = next_sequence;
  last_given_ = next_sequence - 1;
  behind_since_us_ = over_since_us_ = 0;
  resume_.acknowledge(0, 0);
  scans_.seek(next_sequence);
  scans_.acknowledge(next_sequence, next_sequence);
  scans_.set_silent(false);
  live_.set_next_sequence(next_sequence);
  submaps_.begin(next_submap, next_sequence, false);
  state_ = State::kRunning;
  if (next_sequence > 0) {
    spdlog::info("session {}: going on after submap {} at scan {}", endpoint_.session_id(), next_submap - 1,
                 next_sequence);
  } else {
    spdlog::info("session {}: beginning", endpoint_.session_id());
  }
}

void FrontendProcess::on_scan(Delivery delivery) {
  if (delivery.id <= last_given_) return;
  last_given_ = delivery.id;
  ++in_worker_;
  const auto& offer = scans_.last_offer();
  const bool final = offer && offer->ended != 0 && delivery.id + 1 == offer->next_id;
  worker_.add({delivery.id, std::move(delivery.bytes), std::nullopt, final});
}

// Takes the newest scan if a real-time player is too far ahead; the sequence numbers show what was skipped. A
// scan that is under way is waited for: were it given up for a newer one each time, none would ever arrive.
void FrontendProcess::skip_to_newest() {
  const offer_t* offer = scans_.offer();
  if (offer == nullptr || offer->pacing != offer_t::REAL_TIME || paused_ || scans_.busy()) return;
  if (offer->next_id - scans_.next_delivery() > options_.real_time_backlog) scans_.seek(offer->next_id - 1);
}

void FrontendProcess::feed_live() {
  // A player that stands still has not given up its drive, whose numbers no other scan may take.
  const auto& offer = scans_.last_offer();
  const bool owned = scans_.offer() != nullptr || (offer && presence_.may_return(offer->sender_id));
  live_.refuse(
      owned ? "a player plays this session's drive. Stop the sensor's driver, or give the run an LCM URL of "
              "its own (--lcm-url)"
            : "");
  if (!live_.active()) live_.set_next_sequence(last_given_ + 1);
  live_.poll();
  while (!live_.empty() && in_worker_ < kInWorker / 2 && !submaps_.full()) {
    auto scan = live_.pop();
    if (scan->sequence <= last_given_) {  // a player has gone beyond it meanwhile
      ++endpoint_.counters()["live_scans_dropped"];
      continue;
    }
    const std::int64_t sequence = last_given_ = scan->sequence;
    ++in_worker_;
    worker_.add({sequence, nullptr, std::move(scan), false});
  }
}

void FrontendProcess::feed() {
  if (state_ != State::kRunning) return;
  feed_live();
  const offer_t* offer = scans_.offer();
  const bool room = !submaps_.full() && !live_.active() && !paused_;
  // Beyond what the player has waits only who was told so by somebody else.
  const bool beyond = offer != nullptr && scans_.next_delivery() > offer->next_id;
  if (last_given_ + 1 > scans_.next_delivery() || (beyond && scans_.next_delivery() > last_given_ + 1)) {
    scans_.seek(last_given_ + 1);
  }
  const bool real_time = offer != nullptr && offer->pacing == offer_t::REAL_TIME;
  if (room) skip_to_newest();
  // In real time one scan is fetched while another is registered: what is fetched early is old when its turn
  // comes.
  const int space = real_time ? (in_worker_ < 2 ? 1 : 0) : std::max(0, kInWorker - in_worker_);
  scans_.set_limit(room ? scans_.next_delivery() + space : kNothing);
  if (offer != nullptr && scans_.ended() && in_worker_ == 0 && last_given_ + 1 >= offer->next_id) {
    end_session("the player has no more scans");
  }
}

void FrontendProcess::end_session(const std::string& why) {
  if (state_ != State::kRunning) return;
  spdlog::info("{}: cutting the last submap", why);
  state_ = State::kEnding;
  scans_.set_limit(kNothing);
  if (paused_) worker_.pause(false);  // what waits in the worker comes before the end
  paused_ = false;
  worker_.finish();
}

void FrontendProcess::publish(const OdometryResult& result) {
  const std::int64_t session = endpoint_.session_id(), sender = endpoint_.sender_id();
  endpoint_.publish(kOdometryChannel, to_message(result, session, sender, odometry_number_++));
}

void FrontendProcess::on_event(RegistrationEvent event) {
  if (event.error) std::rethrow_exception(event.error);
  if (event.generation != generation_) return;
  for (const auto& warning : event.warnings) presence_.warn(warning);
  if (event.sequence >= 0) {
    in_worker_ = std::max(0, in_worker_ - 1);
    if (event.rejected)
      endpoint_.reject(chunk_channel(kScanTopic),
                       "scan " + std::to_string(event.sequence) + " is no valid scan_t");
    next_sequence_ = std::max(next_sequence_, event.sequence + 1);
  }
  if (event.odometry) {
    ++endpoint_.counters()["scans_registered"];
    endpoint_.counters()["scans_skipped"] += event.odometry->n_skipped;
    for (const OdometryResult& earlier : event.revised) publish(earlier);
    publish(*event.odometry);
  }
  if (!event.submaps.empty() || event.ended) {
    endpoint_.counters()["submaps_cut"] += static_cast<std::int64_t>(event.submaps.size());
    submaps_.add(std::move(event.submaps), event.ended);
  }
  if (event.ended) state_ = State::kOver;
  scans_.acknowledge(next_sequence_, submaps_.stored_sequence());
  feed();
}

// A back-end that was started again and has less than was confirmed before (its disk lost power, say) cannot
// be given the submaps in between any more: go on from what it has.
void FrontendProcess::check_backend() {
  if (options_.standalone || state_ == State::kWaiting) return;
  const offer_t* offer = resume_.offer();
  if (offer == nullptr || offer->first_id >= submaps_.first()) {
    behind_since_us_ = 0;
    return;
  }
  if (behind_since_us_ == 0) behind_since_us_ = bus_.now_us();
  if (bus_.now_us() - behind_since_us_ < kBehindPatienceUs) return;
  spdlog::warn("the back-end has only {} submaps: going back to its state", offer->first_id);
  behind_since_us_ = 0;
  state_ = State::kWaiting;
  resume_.seek(offer->first_id);
}

bool FrontendProcess::over() {
  if (state_ != State::kOver || !submaps_.empty()) return false;
  // The back-end must know that nothing follows: one that was killed is told when it is back.
  const auto& resume = resume_.last_offer();
  if (!options_.standalone && !(resume && resume->ended != 0)) return false;
  if (over_since_us_ == 0) over_since_us_ = bus_.now_us();
  scans_.acknowledge(next_sequence_, fetch_t::ALL);
  if (resume) resume_.acknowledge(resume->next_id, fetch_t::ALL);
  // The player may have missed that it can go: stay while it offers scans, or a link to it may be down.
  const std::int64_t now = bus_.now_us();
  if (scans_.offer() == nullptr) silent_player_us_ = now;
  const auto& offer = scans_.last_offer();
  const bool player_waits = offer && presence_.missed(offer->sender_id) &&
                            now - std::max(over_since_us_, silent_player_us_) < 4 * kLingerUs &&
                            now - over_since_us_ < 12 * kLingerUs;
  return !player_waits && now - over_since_us_ > kLingerUs / 6;
}

void FrontendProcess::report() {
  Report report;
  report.done = next_sequence_;
  const auto& offer = scans_.last_offer();
  if (offer && offer->ended != 0) report.total = offer->next_id;
  report.state = status_t::RUNNING;
  const bool backend = options_.standalone || resume_.offer() != nullptr;
  if (state_ == State::kWaiting) {
    report.state = status_t::WAITING;
    report.text = backend ? "taking up the session" : "waiting for a back-end (hp2_backend --session DIR)";
  } else if (state_ == State::kOver) {
    report.text = over_since_us_ != 0 ? "the session is complete"
                                      : "waiting for the back-end to store the last submaps";
  } else if (paused_) {
    report.state = status_t::PAUSED;
    report.text = "paused";
  } else if (scans_.offer() == nullptr && !live_.active()) {
    report.state = status_t::WAITING;
    report.text = "waiting for scans (hp2_player DATA, or a sensor on HP2_SCAN)";
  } else {
    report.text =
        backend ? "registering" : "registering; the back-end is away, submaps are kept until it returns";
  }
  endpoint_.counters()[kBegunCounter] = state_ == State::kWaiting ? 0 : 1;
  endpoint_.counters()["submaps_kept"] = static_cast<std::int64_t>(submaps_.size());
  presence_.set(report);
}

bool FrontendProcess::tick() {
  endpoint_.poll();
  const bool nothing_to_end = state_ == State::kWaiting && (stop_signals() > 0 || resume_.offer() == nullptr);
  if (stop_signals() > 1 || ((stop_ || stop_signals() > 0) && nothing_to_end)) {
    exit_status_ = 130;
    return false;
  }
  if (stop_ || stop_signals() > 0) end_session("stop");
  check_twin();
  if (state_ == State::kWaiting && bus_.now_us() - started_us_ > kListenForTwinUs) {
    if (options_.standalone) {
      begin(0, 0, {});
    } else {
      resume_.set_limit(kEverything);
    }
  }
  if (state_ != State::kWaiting && submaps_.drop_stored()) {
    scans_.acknowledge(next_sequence_, submaps_.stored_sequence());
  }
  check_backend();
  feed();
  report();
  stagnation_.tick(in_worker_ > 0 || state_ == State::kEnding, paused_);
  presence_.poll();
  if (!over()) return true;
  Report last = presence_.report();
  last.state = status_t::FINISHED;
  last.text = "finished";
  presence_.set(last);
  return false;
}

}  // namespace hp2
