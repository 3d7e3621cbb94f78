#include "viewer_headless/process/viewer_process.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/program.hpp"
#include "common/thread_priority.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/peer_summary.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kSubmapsAhead = 3;
constexpr int kOdometryQueue = 64;
constexpr std::int64_t kLingerUs = 2'000'000;  // more than it takes to see that an owner is silent
constexpr std::int64_t kMostLingerUs = 30'000'000;
constexpr std::int64_t kBackendGoneUs = 5'000'000;
constexpr std::int64_t kPairedUs = 2'000;

}  // namespace

std::vector<Pose> ground_truth_by_sequence(const std::vector<StampedPose>& truth,
                                           const std::vector<TrajectoryPose>& trajectory) {
  std::vector<Pose> poses;
  if (truth.empty() || trajectory.empty()) return poses;
  Pose unknown;
  unknown.translation.setConstant(std::numeric_limits<double>::quiet_NaN());
  poses.assign(static_cast<std::size_t>(trajectory.back().sequence + 1), unknown);
  for (const auto& p : trajectory) {
    const auto after =
        std::lower_bound(truth.begin(), truth.end(), p.utime - kPairedUs,
                         [](const StampedPose& t, std::int64_t utime) { return t.utime < utime; });
    if (after != truth.end() && after->utime <= p.utime + kPairedUs) {
      poses[static_cast<std::size_t>(p.sequence)] = after->pose;
    }
  }
  return poses;
}

ViewerProcess::ViewerProcess(LcmBus& bus, const ViewerConfig& config, const ViewerProcessOptions& options)
    : bus_(bus),
      config_(config),
      options_(options),
      spool_((prepare_output_folder(options.out_folder), options.out_folder)),
      endpoint_(bus),
      presence_(endpoint_, "hp2_viewer_headless"),
      control_(endpoint_, "hp2_viewer_headless",
               [this](const control_t& m, bool named) {
                 if (m.command == control_t::STOP) (named ? stop_ : stop_all_) = true;
                 export_now_ = export_now_ || m.command == control_t::EXPORT;
               }),
      stagnation_(endpoint_, presence_, options.run.give_up_after_s),
      graph_(endpoint_, {kGraphTopic, Inbox::Order::kLatest},
             [this](const Delivery& d) {
               auto graph = decode_graph(d.bytes->data(), d.bytes->size(), endpoint_.session_id());
               if (!graph || graph->revision != d.id) {
                 return endpoint_.reject(chunk_channel(kGraphTopic), "not a valid graph_t");
               }
               graph_revision_ = graph->revision;
               new_graph_ = std::move(graph);
             }),
      trajectory_(endpoint_, {kTrajectoryTopic, Inbox::Order::kLatest},
                  [this](const Delivery& d) {
                    auto t = decode_trajectory(d.bytes->data(), d.bytes->size(), endpoint_.session_id());
                    if (!t || t->revision != d.id)
                      return endpoint_.reject(chunk_channel(kTrajectoryTopic), "not a valid trajectory_t");
                    trajectory_revision_ = t->revision;
                    state_.trajectory = std::move(t->trajectory);
                  }),
      submaps_(endpoint_, {kSessionSubmapTopic, Inbox::Order::kAll, kSubmapsAhead},
               [this](const Delivery& d) {
                 const auto package = decode_submap(d.bytes->data(), d.bytes->size(), endpoint_.session_id());
                 if (!package || package->submap.id != d.id) {
                   return endpoint_.reject(chunk_channel(kSessionSubmapTopic), "not a valid submap_t");
                 }
                 spool_.append(d.bytes->data(), d.bytes->size());
               }) {
  endpoint_.adopt_session_from({kGraphTopic, kTrajectoryTopic, kSessionSubmapTopic});
  endpoint_.set_session(options_.run.session_id);
  if (options_.run.session_id == 0) {
    endpoint_.leave_silent_session([this] { return graph_revision_ < 0 && spool_.size() == 0; });
  }
  bus_.subscribe(
      kOdometryChannel, [this](const auto* data, auto size) { on_odometry(data, size); }, kOdometryQueue);
}

ViewerProcess::~ViewerProcess() {
  if (writer_.joinable()) writer_.join();
}

void ViewerProcess::on_odometry(const std::uint8_t* data, std::size_t size) {
  odometry_t m;
  if (!safe_decode(data, size, m)) return endpoint_.reject(kOdometryChannel, "not a valid odometry_t");
  if (m.session_id != endpoint_.session_id()) return;
  last_odometry_us_ = bus_.now_us();
  if (first_odometry_us_ == 0) first_odometry_us_ = last_odometry_us_;
}

// Graph, trajectory and submaps of the ended session are all here and belong together.
bool ViewerProcess::complete() const {
  return state_.ended && trajectory_revision_ == state_.revision &&
         spool_.size() >= static_cast<std::int64_t>(state_.map_from_submap.size());
}

SessionView ViewerProcess::view() {
  SessionView v;
  v.session_id = endpoint_.session_id();
  v.graph = state_;
  v.submap_count =
      std::min<std::int64_t>(spool_.size(), static_cast<std::int64_t>(state_.map_from_submap.size()));
  v.read_submap = [this, id = v.session_id](std::int64_t submap) { return spool_.read(submap, id); };
  v.ground_truth = ground_truth_by_sequence(options_.ground_truth, state_.trajectory);
  v.meta = options_.meta;
  v.processes = peers_as_json(presence_);
  v.viewer_peak_memory_mb = peak_memory_mb();
  v.warnings = presence_.warnings();
  for (const auto& [id, peer] : presence_.peers()) {
    if (peer.status.process != "hp2_player" || peer.status.session_id != endpoint_.session_id()) continue;
    for (const auto& c : peer.status.counters) {
      if (c.name == "scans_played") v.scans_in = std::max(v.scans_in, c.value);
    }
  }
  if (last_odometry_us_ > first_odometry_us_) {
    v.elapsed_s = 1e-6 * static_cast<double>(last_odometry_us_ - first_odometry_us_);
  }
  return v;
}

void ViewerProcess::start_writing() {
  writing_ = true;
  writing_final_ = complete();
  written_revision_ = state_.revision;
  last_write_us_ = bus_.now_us();
  writer_ = std::thread([this, v = view()] {
    std::size_t files = 0;
    std::exception_ptr error;
    give_way();
    try {
      files = write_session(v, options_.out_folder, config_).size();
    } catch (...) {
      error = std::current_exception();
    }
    bus_.post([this, files, error] {
      written_files_ = static_cast<std::int64_t>(files);
      error_ = error;
      finish_writing();
    });
  });
}

void ViewerProcess::finish_writing() {
  writer_.join();
  writing_ = false;
  written_final_ = writing_final_ && !error_;
  if (error_) std::rethrow_exception(error_);
  spdlog::info("{} files written to {}", written_files_, options_.out_folder);
}

void ViewerProcess::report() {
  Report report;
  report.state = status_t::RUNNING;
  report.done = written_files_;
  if (writing_) {
    report.text = "writing " + options_.out_folder;
  } else if (graph_.offer() == nullptr) {
    report.state = status_t::WAITING;
    report.text = "waiting for a back-end (hp2_backend --session DIR)";
  } else if (complete()) {
    report.text = "the session is written";
  } else {
    report.text = "following the session";
  }
  endpoint_.counters()["submaps_fetched"] = spool_.size();
  presence_.set(report);
}

// The back-end may not know yet that everything is written. Its offers show that it is there: a session that
// is written quickly is finished before the back-end's first STATUS. While it is silent the link may be
// down.
bool ViewerProcess::backend_waits() {
  const std::int64_t now = bus_.now_us();
  if (written_us_ == 0) written_us_ = told_since_us_ = now;
  const auto& offer = graph_.last_offer();
  if (!offer || !presence_.missed(offer->sender_id) || now - written_us_ > kMostLingerUs) return false;
  if (graph_.offer() == nullptr) told_since_us_ = now;
  return now - told_since_us_ < kLingerUs;
}

bool ViewerProcess::tick() {
  endpoint_.poll();
  // Invalid submaps are requested again.
  if (submaps_.next_delivery() > spool_.size()) submaps_.seek(spool_.size());
  if (new_graph_) {
    auto trajectory = std::move(state_.trajectory);
    state_ = std::move(*new_graph_);
    state_.trajectory = std::move(trajectory);
    new_graph_.reset();
  }
  // A viewer is done with the last graph when it has written everything; the back-end waits for that.
  const bool unwritten = state_.ended && !written_final_;
  graph_.acknowledge(graph_revision_ + 1, graph_revision_ + (unwritten ? 0 : 1));
  trajectory_.acknowledge(trajectory_revision_ + 1, trajectory_revision_ + 1);
  submaps_.acknowledge(spool_.size(), spool_.size());
  // A command to all ends the session: it is written to its end while there is a back-end that has it.
  if (graph_.offer() != nullptr) backend_us_ = bus_.now_us();
  const bool stopping =
      stop_ || stop_signals() > 0 || (stop_all_ && bus_.now_us() - backend_us_ > kBackendGoneUs);
  if (!writing_) {
    const bool due = options_.live_every_s > 0 && state_.revision != written_revision_ &&
                     bus_.now_us() - last_write_us_ > static_cast<std::int64_t>(options_.live_every_s * 1e6);
    const bool something = !state_.trajectory.empty() && graph_revision_ >= 0;
    const bool final = complete() && !written_final_;
    if (final || (something && (due || export_now_ || (stopping && state_.revision != written_revision_)))) {
      export_now_ = false;
      start_writing();
    }
  }
  report();
  stagnation_.tick(writing_, written_final_);
  presence_.poll();
  const bool stay = (options_.keep_running && !stop_all_) || !written_final_ || backend_waits();
  if (writing_ || (!stopping && stay)) return true;
  exit_status_ = written_final_ ? 0 : 130;
  if (written_final_ && state_.trajectory.empty()) {
    spdlog::error("the session has ended without a pose: every scan was refused, or none came");
    exit_status_ = 1;
  }
  Report last = presence_.report();
  last.state = status_t::FINISHED;
  last.text = "finished";
  presence_.set(last);
  return false;
}

}  // namespace hp2
