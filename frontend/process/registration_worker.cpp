#include "frontend/process/registration_worker.hpp"

#include <algorithm>
#include <utility>

#include "common/registration/submap_normals.hpp"
#include "common/thread_priority.hpp"
#include "frontend/odometry/submap_builder.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMostParcels = 4;  // finished submaps that wait to be packed
constexpr std::size_t kMostUsedUp = 4;   // registered scans whose memory is kept

}  // namespace

RegistrationWorker::RegistrationWorker(const FrontendConfig& config, int threads,
                                       std::function<void(RegistrationEvent)> sink)
    : config_(config), threads_(threads), sink_(std::move(sink)) {
  decoder_ = std::thread([this] { run_thread(&RegistrationWorker::decode_loop); });
  registrar_ = std::thread([this] { run_thread(&RegistrationWorker::register_loop); });
  packer_ = std::thread([this] { run_thread(&RegistrationWorker::pack_loop); });
}

RegistrationWorker::~RegistrationWorker() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  for (auto* wake : {&to_decode_, &to_register_, &to_pack_}) wake->notify_all();
  decoder_.join();
  registrar_.join();
  packer_.join();
}

std::int64_t RegistrationWorker::begin(std::int64_t session_id, const std::vector<std::uint8_t>& state) {
  std::unique_lock<std::mutex> lock(mutex_);
  jobs_.clear();
  parcels_.clear();
  ++generation_;
  to_register_.notify_all();  // it may wait for parcels to be packed
  idle_.wait(lock, [this] { return !registering_; });
  session_id_ = session_id;
  frontend_ = std::make_unique<Frontend>(config_, threads_);
  if (!state.empty()) frontend_->restore_state(state);
  return generation_;
}

void RegistrationWorker::add(ScanJob job) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const bool decoded = job.scan.has_value();
  jobs_.push_back({std::move(job), false, decoded});
  (decoded ? to_register_ : to_decode_).notify_all();
}

void RegistrationWorker::finish() {
  const std::lock_guard<std::mutex> lock(mutex_);
  jobs_.push_back({{}, true, true});
  to_register_.notify_all();
}

void RegistrationWorker::pause(bool paused) {
  const std::lock_guard<std::mutex> lock(mutex_);
  paused_ = paused;
  to_register_.notify_all();
}

// An exception that left a thread would end the process without a message.
void RegistrationWorker::run_thread(void (RegistrationWorker::*loop)()) {
  RegistrationEvent event;
  try {
    (this->*loop)();
    return;
  } catch (...) {
    event.error = std::current_exception();
  }
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    registering_ = false;
    event.generation = generation_;
  }
  idle_.notify_all();
  sink_(std::move(event));
}

void RegistrationWorker::decode_loop() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    const auto undecoded = [](const Job& job) { return !job.decoded; };
    const auto it = std::find_if(jobs_.begin(), jobs_.end(), undecoded);
    if (it == jobs_.end()) {
      to_decode_.wait(lock);
      continue;
    }
    const auto bytes = it->scan.bytes;
    const std::int64_t generation = generation_;
    Scan used_up;
    if (!used_up_.empty()) {
      used_up = std::move(used_up_.back());
      used_up_.pop_back();
    }
    lock.unlock();
    auto scan = decode_scan(bytes->data(), bytes->size(), std::move(used_up), false);
    lock.lock();
    if (generation != generation_) continue;
    // Jobs are only taken from the front and only when decoded: the first undecoded one is still this one.
    const auto job = std::find_if(jobs_.begin(), jobs_.end(), undecoded);
    job->scan.scan = std::move(scan);
    job->scan.bytes.reset();
    job->decoded = true;
    to_register_.notify_all();
  }
}

void RegistrationWorker::register_loop() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    if (jobs_.empty() || !jobs_.front().decoded || (paused_ && !jobs_.front().finish)) {
      to_register_.wait(lock);
      continue;
    }
    Job job = std::move(jobs_.front());
    jobs_.pop_front();
    registering_ = true;
    const std::int64_t generation = generation_;
    lock.unlock();
    std::vector<Parcel> parcels;
    RegistrationEvent event = run(job, parcels);
    event.generation = generation;
    lock.lock();
    registering_ = false;
    if (job.scan.scan && used_up_.size() < kMostUsedUp) used_up_.push_back(std::move(*job.scan.scan));
    if (generation == generation_) {
      for (auto& parcel : parcels) {
        parcel.generation = generation;
        parcel.session_id = session_id_;
        parcels_.push_back(std::move(parcel));
      }
      if (!parcels.empty()) to_pack_.notify_all();
    }
    idle_.notify_all();
    lock.unlock();
    sink_(std::move(event));
    lock.lock();
    to_register_.wait(lock, [this] { return stop_ || parcels_.size() <= kMostParcels; });
  }
}

RegistrationEvent RegistrationWorker::run(Job& job, std::vector<Parcel>& parcels) {
  RegistrationEvent event;
  bool ends = job.finish;
  if (!job.finish) {
    event.sequence = job.scan.sequence;
    event.rejected = !job.scan.scan;
    ends = job.scan.final;
    if (job.scan.scan) {
      job.scan.scan->sequence = job.scan.sequence;
      FrontendOutput output = frontend_->process(*job.scan.scan);
      event.odometry = output.odometry;
      event.revised = std::move(output.revised);
      if (output.finished_submap) {
        parcels.push_back({0, 0, std::move(output.finished_submap), frontend_->save_state(), false, false});
      }
    }
  }
  if (ends) {
    Parcel end;
    end.submap = frontend_->finish();
    if (end.submap) {
      end.state = frontend_->save_state();
    } else if (!parcels.empty()) {
      parcels.back().last = true;
    }
    end.last = end.ended = true;
    parcels.push_back(std::move(end));
  }
  event.warnings = frontend_->take_warnings();
  return event;
}

RegistrationEvent RegistrationWorker::pack(Parcel parcel) {
  RegistrationEvent event;
  event.generation = parcel.generation;
  event.ended = parcel.ended;
  if (parcel.submap) {
    SubmapOut out;
    out.id = parcel.submap->id;
    out.next_sequence = parcel.submap->scans.empty() ? 0 : parcel.submap->scans.back().sequence + 1;
    estimate_normals(*parcel.submap);
    const SubmapPackage package{std::move(*parcel.submap), std::move(parcel.state), parcel.last};
    out.message = std::make_shared<EncodedMessage>(encode_submap(package, parcel.session_id));
    event.submaps.push_back(std::move(out));
  }
  return event;
}

void RegistrationWorker::pack_loop() {
  give_way();
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    if (parcels_.empty()) {
      to_pack_.wait(lock);
      continue;
    }
    Parcel parcel = std::move(parcels_.front());
    parcels_.pop_front();
    to_register_.notify_all();
    lock.unlock();
    sink_(pack(std::move(parcel)));
    lock.lock();
  }
}

}  // namespace hp2
