// The viewer on the bus: fetches the session from the back-end and writes its files, live and at the end.
#pragma once
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/transport/inbox.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/process.hpp"
#include "common/transport/stagnation.hpp"
#include "player/scan_source.hpp"
#include "viewer_headless/map/submap_spool.hpp"
#include "viewer_headless/write_session.hpp"

namespace hp2 {

/// How the viewer behaves on the bus.
struct ViewerProcessOptions {
  RunOptions run;
  std::string out_folder;
  double live_every_s = 0.0;  ///< Write everything so often while the drive runs; 0: only at the end.
  bool keep_running = false;  ///< Stay after the end of the session.
  std::map<std::string, std::string> meta;  ///< Shown in the summary.
  std::vector<StampedPose> ground_truth;    ///< Empty: none.
};

/// One run of hp2_viewer_headless, live.
class ViewerProcess {
 public:
  /// @throws Error if the output folder cannot be written
  ViewerProcess(LcmBus& bus, const ViewerConfig& config, const ViewerProcessOptions& options);
  ~ViewerProcess();
  ViewerProcess(const ViewerProcess&) = delete;
  ViewerProcess& operator=(const ViewerProcess&) = delete;

  /// To be called every few milliseconds.
  /// @return false when the session has ended and is written, or after a stop
  /// @throws Error if a file cannot be written
  bool tick();
  int exit_status() const { return exit_status_; }

 private:
  void on_odometry(const std::uint8_t* data, std::size_t size);
  bool complete() const;
  bool backend_waits();
  void start_writing();
  void finish_writing();
  SessionView view();
  void report();

  LcmBus& bus_;
  ViewerConfig config_;
  ViewerProcessOptions options_;
  SubmapSpool spool_;
  Endpoint endpoint_;
  Presence presence_;
  ControlListener control_;
  Stagnation stagnation_;
  Inbox graph_, trajectory_, submaps_;
  GraphState state_;
  std::int64_t graph_revision_ = -1, trajectory_revision_ = -1, written_revision_ = -1;
  std::optional<GraphState> new_graph_;
  std::int64_t first_odometry_us_ = 0, last_odometry_us_ = 0;
  std::int64_t last_write_us_ = 0, written_files_ = 0, written_us_ = 0, backend_us_ = 0;
  std::int64_t told_since_us_ = 0;  // the back-end is there and learns that everything is written
  bool export_now_ = false, stop_ = false, stop_all_ = false, written_final_ = false, writing_final_ = false;

  std::thread writer_;
  bool writing_ = false;
  std::exception_ptr error_;
  int exit_status_ = 0;
};

/// Ground truth in order of the trajectory's sequence numbers: entry i belongs to scan i, not-a-number poses
/// where none was recorded within 2 ms of the scan's end.
std::vector<Pose> ground_truth_by_sequence(const std::vector<StampedPose>& truth,
                                           const std::vector<TrajectoryPose>& trajectory);

}  // namespace hp2
