#include "backend/process/backend_process.hpp"

#include <memory>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/error.hpp"
#include "common/session/damage.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/peer_summary.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kCorrectionPeriodUs = 500'000;
constexpr std::int64_t kRetryUs = 1'000'000;
constexpr std::int64_t kKeepStatusesUs = 10'000'000;
constexpr std::int64_t kLingerUs = 2'000'000;
constexpr std::int64_t kGoneUs = 5'000'000;  // a front-end that was silent for so long does not come back
constexpr std::size_t kMostViewers = 64;
constexpr std::int64_t kBelievedAfterUs = 600'000;
constexpr int kSubmapsAhead = 2;
constexpr int kMostRefusals = 5;  // of one submap

}  // namespace

BackendProcess::BackendProcess(LcmBus& bus, const BackendConfig& config, const BackendProcessOptions& options)
    : bus_(bus),
      options_(options),
      endpoint_(bus),
      presence_(endpoint_, "hp2_backend"),
      stagnation_(endpoint_, presence_, options.run.give_up_after_s),
      worker_(options.session_folder, config, options.run.session_id,
              [this](SessionSnapshot s) {
                bus_.post([this, p = std::make_shared<SessionSnapshot>(std::move(s))] {
                  on_snapshot(std::move(*p));
                });
              }),
      reader_(options.session_folder, SessionStore::Access::kReadOnly),
      loader_(
          [this](std::int64_t id) {
            return EncodedMessage(encode_submap({read_submap(id), {}, false}, worker_.session_id()));
          },
          2, 1),
      control_(endpoint_, "hp2_backend",
               [this](const control_t& m, bool named) {
                 if (m.command == control_t::STOP) (named ? stop_ : stop_all_) = true;
               }),
      submaps_(endpoint_, {kSubmapTopic, Inbox::Order::kAll, kSubmapsAhead},
               [this](Delivery d) {
                 handed_ = d.id + 1;
                 worker_.add(std::move(d));
               }),
      resume_(endpoint_, kResumeTopic, [this](std::int64_t) { return resume_message(); }),
      graph_(endpoint_, kGraphTopic, [this](std::int64_t) { return now_.graph; }),
      trajectory_(endpoint_, kTrajectoryTopic, [this](std::int64_t) { return now_.trajectory; }),
      session_submaps_(endpoint_, kSessionSubmapTopic, [this](std::int64_t id) { return loader_.get(id); }) {
  started_us_ = frontend_us_ = bus.now_us();
  // A viewer is done with the last graph once it has written everything.
  graph_.on_reader([this](const fetch_t& fetch) {
    if (!now_.ended || fetch.done_id < graph_.next()) {
      done_claims_.erase(fetch.sender_id);
      return;
    }
    if (done_claims_.size() >= kMostViewers) done_claims_.clear();
    done_claims_.emplace(fetch.sender_id, bus_.now_us());
  });
  endpoint_.set_session(worker_.session_id());
  submaps_.set_limit(0);
  for (const char* name : {"submaps_stored", "closures_accepted", "closures_rejected"})
    endpoint_.counters()[name] = 0;
  spdlog::info("session {} in {}", worker_.session_id(), options_.session_folder);
  worker_.write_meta(options_.meta);
}

void BackendProcess::on_snapshot(SessionSnapshot s) {
  if (!s.rejected.empty()) {
    endpoint_.reject(chunk_channel(kSubmapTopic),
                     "submap " + std::to_string(s.submap_count) + ": " + s.rejected);
    ask_again(s.rejected);
    return;
  }
  refusals_ = 0;
  if (!opened_) {
    submaps_.seek(s.submap_count);
    handed_ = s.submap_count;
    opened_ = true;
  }
  now_ = std::move(s);
  resume_message_.reset();
  for (const auto& closure : now_.new_closures) endpoint_.publish(kClosureChannel, closure);
  for (const auto& closure : now_.new_closures) {
    ++endpoint_.counters()[closure.accepted != 0 ? "closures_accepted" : "closures_rejected"];
  }
  endpoint_.counters()["submaps_stored"] = now_.submap_count;
  loader_.set_end(now_.submap_count);
  submaps_.acknowledge(now_.submap_count, now_.submap_count);
  resume_.offer(now_.submap_count, now_.submap_count + 1, now_.last_stored);
  graph_.offer(now_.revision, now_.revision + 1, now_.ended);
  trajectory_.offer(now_.revision, now_.revision + 1, now_.ended);
  session_submaps_.offer(0, now_.submap_count, now_.last_stored);
  publish_correction();
}

// For viewers; in the loader's thread. Of a damaged one they get what is left.
Submap BackendProcess::read_submap(std::int64_t id) {
  try {
    return reader_.read_submap(id);
  } catch (const DamageError&) {
    std::vector<std::string> said;
    Submap submap = reader_.read_what_is_left(id, said);
    bus_.post([this, said] {
      for (const std::string& text : said) presence_.warn(text);
    });
    return submap;
  }
}

EncodedMessagePtr BackendProcess::resume_message() {
  if (!resume_message_ && now_.frontend_state) {
    resume_t m = now_.resume;
    m.state = *now_.frontend_state;
    m.state_size = static_cast<std::int32_t>(m.state.size());
    resume_message_ = std::make_shared<EncodedMessage>(encode_message(m));
  }
  return resume_message_;
}

// A submap that makes no sense is asked for again: its sender may have been restarted, or somebody else spoke
// in its name. One that never makes sense ends this process, in words; without it the session would stand
// still for ever.
void BackendProcess::ask_again(const std::string& why) {
  // What was handed over behind it is refused, too: one failure.
  if (retry_us_ != 0) return;
  if (++refusals_ >= kMostRefusals) {
    throw Error(
        "the front-end's submap " + std::to_string(now_.submap_count) + " cannot be stored: " + why +
            " (asked " + std::to_string(refusals_) + " times)",
        chunk_channel(kSubmapTopic),
        "Use a front-end of the same release and start both again: everything stored so far is kept.");
  }
  retry_us_ = bus_.now_us() + kRetryUs;
}

void BackendProcess::watch_submaps() {
  if (!opened_) return;
  if (retry_us_ != 0 && bus_.now_us() > retry_us_) {
    retry_us_ = 0;
    submaps_.seek(now_.submap_count);
    handed_ = now_.submap_count;
  }
  if (now_.last_stored) return;
  submaps_.set_limit(now_.submap_count + kSubmapsAhead);
  const auto& offer = submaps_.last_offer();
  // The session may end with a submap that did not know that it was the last.
  if (!finishing_ && offer && submaps_.ended() && offer->next_id == now_.submap_count &&
      handed_ == now_.submap_count) {
    finishing_ = true;
    worker_.finish();
  }
}

// Who says for a while that it has written everything, and is a viewer by its STATUS. Who leaves says so in
// its last words.
void BackendProcess::believe_viewers() {
  for (const auto& [id, since_us] : done_claims_) {
    const auto peer = presence_.peers().find(id);
    const bool viewer = peer != presence_.peers().end() &&
                        peer->second.status.process == "hp2_viewer_headless" &&
                        peer->second.status.session_id == endpoint_.session_id();
    if (viewer && bus_.now_us() - since_us >= kBelievedAfterUs) done_viewers_.insert(id);
  }
  if (now_.ended && written_revision_ != now_.revision && !done_viewers_.empty()) {
    written_revision_ = now_.revision;
    worker_.write_meta({{kResultsWritten, std::to_string(written_revision_)}});
  }
}

void BackendProcess::publish_correction() {
  last_correction_us_ = bus_.now_us();
  correction_t m;
  m.utime = bus_.wall_us();
  m.session_id = endpoint_.session_id();
  m.revision = now_.revision;
  m.map_from_odom = to_message(now_.map_from_odom);
  endpoint_.publish(kCorrectionChannel, m);
}

// The session remembers how each process fared, so that a viewer can tell of it afterwards.
void BackendProcess::keep_statuses(bool now) {
  if (!opened_ || (!now && bus_.now_us() - last_keep_us_ < kKeepStatusesUs)) return;
  last_keep_us_ = bus_.now_us();
  worker_.write_meta(
      {{"processes", as_text(peers_as_json(presence_))}, {"warnings", as_text(warnings_as_json(presence_))}});
}

// The session is complete and nobody waits for this process any more, neither who is there nor who is silent
// because a link is down.
bool BackendProcess::nobody_waits() const {
  if (!now_.ended || bus_.now_us() - started_us_ < kLingerUs) return false;
  for (const Peer* viewer : presence_.all_missed("hp2_viewer_headless")) {
    if (done_viewers_.count(viewer->status.sender_id) == 0) return false;
  }
  // A front-end that has just begun, or does not know yet that all is stored, would wait for this process for
  // ever. Once one knows it the others, who ran the session before it, are of the past.
  if (presence_.live("hp2_frontend") != nullptr) return false;
  return resume_.over() || presence_.all_missed("hp2_frontend").empty();
}

bool BackendProcess::time_to_go() {
  if (presence_.live("hp2_frontend") != nullptr) frontend_us_ = bus_.now_us();
  if (stop_ || stop_signals() > 0) return true;
  // A command to all ends the session in order, if there is a front-end to end it.
  if (stop_all_) return nobody_waits() || (!now_.ended && bus_.now_us() - frontend_us_ > kGoneUs);
  return options_.exit_when_done && !done_viewers_.empty() && nobody_waits();
}

void BackendProcess::report() {
  Report report;
  report.done = now_.submap_count;
  report.state = status_t::RUNNING;
  if (!opened_) {
    report.text = "opening the session";
  } else if (now_.ended) {
    report.total = now_.submap_count;
    report.text = "the session is complete; viewers can fetch it";
    if (options_.exit_when_done && done_viewers_.empty())
      report.text += ": waiting for one to write it (hp2_viewer_headless --out DIR)";
  } else if (now_.last_stored || finishing_) {
    report.text = "finishing the session";
  } else if (submaps_.offer() == nullptr) {
    report.state = status_t::WAITING;
    report.text = "waiting for a front-end (hp2_frontend)";
  } else {
    report.text = "closing loops";
  }
  presence_.set(report);
}

bool BackendProcess::tick() {
  worker_.rethrow_error();
  loader_.rethrow_error();
  endpoint_.poll();
  watch_submaps();
  if (opened_ && bus_.now_us() - last_correction_us_ > kCorrectionPeriodUs) publish_correction();
  believe_viewers();
  keep_statuses(false);
  report();
  stagnation_.tick(worker_.busy(), now_.ended && !options_.exit_when_done);
  presence_.poll();
  if (!time_to_go()) return true;
  exit_status_ = now_.ended || stop_ || stop_all_ ? 0 : 130;
  Report last = presence_.report();
  last.state = status_t::FINISHED;
  last.text = now_.ended ? "finished" : "stopped; the session can be taken up again";
  presence_.set(last);
  keep_statuses(true);
  return false;
}

}  // namespace hp2
