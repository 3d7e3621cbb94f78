#include "backend/process/session_worker.hpp"

#include <memory>
#include <utility>

#include <spdlog/spdlog.h>

#include "common/thread_priority.hpp"

namespace hp2 {

SessionWorker::SessionWorker(const std::string& folder, const BackendConfig& config, std::int64_t session_id,
                             std::function<void(SessionSnapshot)> sink)
    : store_(folder, SessionStore::Access::kReadWrite, session_id),
      backend_(config, store_),
      session_id_(store_.session_id()),
      sink_(std::move(sink)) {
  closures_told_ = backend_.graph().closures.size();
  // Once the last submap is stored nobody goes on from the state.
  frontend_state_ = std::make_shared<const std::vector<std::uint8_t>>(
      store_.last_submap_stored() ? std::vector<std::uint8_t>() : store_.read_frontend_state());
  // A session whose last submap was stored, but not refined, when the process died is refined now.
  jobs_.emplace_back([this] {
    if (store_.last_submap_stored() && !backend_.graph().ended) backend_.finish();
    return true;
  });
  thread_ = std::thread([this] { work(); });
}

SessionWorker::~SessionWorker() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void SessionWorker::add(Delivery submap) {
  const std::lock_guard<std::mutex> lock(mutex_);
  jobs_.emplace_back([this, delivery = std::move(submap)] { return store(delivery); });
  wake_.notify_all();
}

void SessionWorker::finish() {
  const std::lock_guard<std::mutex> lock(mutex_);
  jobs_.emplace_back([this] {
    if (!backend_.graph().ended) backend_.finish();
    return true;
  });
  wake_.notify_all();
}

void SessionWorker::write_meta(std::map<std::string, std::string> values) {
  const std::lock_guard<std::mutex> lock(mutex_);
  jobs_.emplace_back([this, v = std::move(values)] {
    store_.write_meta(v);
    return false;
  });
  wake_.notify_all();
}

bool SessionWorker::busy() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return working_ || !jobs_.empty();
}

void SessionWorker::rethrow_error() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (error_) std::rethrow_exception(error_);
}

bool SessionWorker::store(const Delivery& delivery) {
  auto package = decode_submap(delivery.bytes->data(), delivery.bytes->size(), session_id_);
  if (!package || package->submap.id != store_.submap_count()) {
    SessionSnapshot nothing;
    nothing.rejected = package ? "it calls itself submap " + std::to_string(package->submap.id)
                               : "it is no valid submap_t of this session";
    nothing.submap_count = store_.submap_count();
    sink_(std::move(nothing));
    return false;
  }
  const BackendUpdate update = backend_.add_submap(package->submap, package->frontend_state, package->last);
  frontend_state_ = std::make_shared<const std::vector<std::uint8_t>>(std::move(package->frontend_state));
  spdlog::info("submap {}: {} scans, {:.1f} m, {} verdicts on closures, {:.0f} ms", package->submap.id,
               package->submap.scans.size(), package->submap.travelled_m, update.new_verdicts.size(),
               update.ms_total);
  if (package->last) {
    const BackendUpdate last = backend_.finish();
    spdlog::info("session finished in {:.0f} ms", last.ms_total);
  }
  return true;
}

SessionSnapshot SessionWorker::snapshot() {
  const GraphState& graph = backend_.graph();
  SessionSnapshot s;
  s.submap_count = store_.submap_count();
  s.next_sequence = graph.trajectory.empty() ? 0 : graph.trajectory.back().sequence + 1;
  s.revision = graph.revision;
  s.last_stored = store_.last_submap_stored() || graph.ended;
  s.ended = graph.ended;
  s.map_from_odom = graph.map_from_odom;
  s.graph = std::make_shared<EncodedMessage>(encode_graph(graph, session_id_));
  s.trajectory = std::make_shared<EncodedMessage>(encode_trajectory(graph, session_id_));
  s.resume.session_id = session_id_;
  s.resume.next_submap_id = s.submap_count;
  s.resume.next_sequence = s.next_sequence;
  s.resume.ended = s.last_stored ? 1 : 0;
  s.resume.odom_from_submap =
      to_message(graph.trajectory.empty() ? Pose() : graph.trajectory.back().odom_from_sensor);
  s.frontend_state = frontend_state_;
  for (; closures_told_ < graph.closures.size(); ++closures_told_) {
    s.new_closures.push_back(
        to_message(graph.closures[closures_told_], session_id_, static_cast<std::int64_t>(closures_told_)));
  }
  return s;
}

void SessionWorker::work() {
  // A search for closures must delay no scan. Submaps wait with the front-end for as long as it takes.
  give_way();
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    // What was handed over is done before the end: a submap that was fetched is stored.
    if (jobs_.empty()) {
      if (stop_) return;
      wake_.wait(lock);
      continue;
    }
    const auto job = std::move(jobs_.front());
    jobs_.pop_front();
    working_ = true;
    lock.unlock();
    std::exception_ptr error;
    try {
      if (job()) sink_(snapshot());
    } catch (...) {
      error = std::current_exception();
    }
    lock.lock();
    working_ = false;
    if (error) {
      error_ = error;
      return;
    }
  }
}

}  // namespace hp2
