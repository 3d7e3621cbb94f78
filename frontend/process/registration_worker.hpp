// The front-end's work outside the bus's thread: one thread decodes scans, the next registers them, the last
// makes finished submaps ready to be sent.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/transport/inbox.hpp"
#include "common/transport/outbox.hpp"
#include "frontend/frontend.hpp"

namespace hp2 {

/// A scan on its way to registration: encoded, or decoded already.
struct ScanJob {
  std::int64_t sequence = 0;
  std::shared_ptr<ByteVector> bytes;
  std::optional<Scan> scan;
  bool final = false;  ///< The session ends with this scan.
};

/// A finished submap, ready to be sent.
struct SubmapOut {
  std::int64_t id = 0;
  std::int64_t next_sequence = 0;  ///< First scan after it.
  EncodedMessagePtr message;
};

/// What happened to one job.
struct RegistrationEvent {
  std::int64_t generation = 0;             ///< As begin() returned it.
  std::int64_t sequence = -1;              ///< The scan; -1: none (end of session).
  bool rejected = false;                   ///< The scan's bytes were invalid.
  std::optional<OdometryResult> odometry;  ///< If it was registered.
  std::vector<OdometryResult> revised;     ///< Earlier scans that were re-estimated.
  std::vector<SubmapOut> submaps;          ///< That it finished.
  std::vector<std::string> warnings;
  bool ended = false;  ///< The session's last submap is among `submaps`, or there was nothing left to cut.
  std::exception_ptr error;  ///< What ended a thread of the worker (no memory); nothing follows then.
};

/// Runs a Frontend in order. Events are handed to `sink` from its threads.
class RegistrationWorker {
 public:
  RegistrationWorker(const FrontendConfig& config, int threads, std::function<void(RegistrationEvent)> sink);
  ~RegistrationWorker();
  RegistrationWorker(const RegistrationWorker&) = delete;
  RegistrationWorker& operator=(const RegistrationWorker&) = delete;

  /// Begins or continues a session: drops all jobs, waits for the running one and continues from `state`
  /// (empty: begins).
  /// @return a number that marks all events from now on
  /// @throws Error if the state does not fit
  std::int64_t begin(std::int64_t session_id, const std::vector<std::uint8_t>& state);
  void add(ScanJob job);
  /// Cuts the open submap and ends the session, after all jobs given so far.
  void finish();
  /// Lets jobs wait.
  void pause(bool paused);

 private:
  struct Job {
    ScanJob scan;
    bool finish = false;
    bool decoded = false;
  };
  /// A finished submap on its way out, or the end of the session.
  struct Parcel {
    std::int64_t generation = 0, session_id = 0;
    std::optional<Submap> submap;
    std::vector<std::uint8_t> state;
    bool last = false, ended = false;
  };
  void run_thread(void (RegistrationWorker::*loop)());
  void decode_loop();
  void register_loop();
  void pack_loop();
  RegistrationEvent run(Job& job, std::vector<Parcel>& parcels);
  static RegistrationEvent pack(Parcel parcel);

  const FrontendConfig config_;
  const int threads_;
  std::function<void(RegistrationEvent)> sink_;
  std::unique_ptr<Frontend> frontend_;

  std::mutex mutex_;
  // One per thread: a broadcast would wake all three, several times per scan.
  std::condition_variable to_decode_, to_register_, to_pack_, idle_;
  std::deque<Job> jobs_;  // in order; decoded ones may be registered
  std::deque<Parcel> parcels_;
  std::vector<Scan> used_up_;  // registered scans, whose memory the next decoded ones take
  bool paused_ = false, stop_ = false, registering_ = false;
  std::int64_t generation_ = 0, session_id_ = 0;
  std::thread decoder_, registrar_, packer_;
};

}  // namespace hp2
