#include "frontend/frontend.hpp"

#include <string>
#include <utility>

#include "common/byte_io.hpp"
#include "common/error.hpp"
#include "common/registration/stopwatch.hpp"
#include "frontend/odometry/start_search.hpp"
#include "frontend/odometry/track.hpp"

namespace hp2 {
namespace {

constexpr std::uint32_t kStateVersion = 9;

}  // namespace

class Frontend::Impl {
 public:
  Impl(const FrontendConfig& config, int threads)
      : config_(config),
        parallel_(threads),
        preprocessor_(
            {config.min_range_m, config.max_range_m, config.map_point_voxel_m, config.source_voxel_m}),
        track_(config) {
    validate(config);
  }

  FrontendOutput process(const Scan& scan);
  std::optional<Submap> finish() {
    start_.end();
    return track_.finish();
  }
  std::vector<std::uint8_t> save_state() const;
  void restore_state(const std::vector<std::uint8_t>& state);
  std::vector<std::string> take_warnings() { return remarks_.take(); }

 private:
  bool usable_times(const Scan& scan);
  void follow_start(bool was_at_start, FrontendOutput& out);
  void take_up(FoundStart found);
  bool smooth_start();
  // The start's first scan is the last of the submap before: after a loss.
  bool first_is_cut() const { return track_.builder().open_scans().size() < start_results_.size(); }

  FrontendConfig config_;
  Parallel parallel_;
  Preprocessor preprocessor_;
  Track track_;
  StartSearch start_;
  std::vector<OdometryResult> start_results_;  // of the scans that it is about
  Remarks remarks_;
  StampedCloud scan_;  // kept from scan to scan for its memory
};

bool Frontend::Impl::usable_times(const Scan& scan) {
  if (!config_.deskew) return false;
  if (scan.time.empty() || scan.duration_us <= 0) {
    remarks_.once(0,
                  "the scans carry no time in the sweep: they are not deskewed (right if they are "
                  "motion-compensated already)");
    return false;
  }
  if (scan.time.size() != scan.size()) {
    remarks_.once(1, "a scan has " + std::to_string(scan.size()) + " points but " +
                         std::to_string(scan.time.size()) +
                         " times in the sweep: such scans are not deskewed");
    return false;
  }
  // Without branches: a pass over all points of every scan.
  unsigned bad = 0, differs = 0;
  const float first = scan.time.front();
  for (const float t : scan.time) {
    bad |= static_cast<unsigned>(!((t >= -0.01F) & (t <= 1.01F)));  // true for NaN as well
    differs |= static_cast<unsigned>(t != first);
  }
  if (bad != 0) {
    remarks_.once(2, "times in the sweep are not finite or outside 0..1: such scans are not deskewed");
    return false;
  }
  if (differs == 0) {
    remarks_.once(3, "times in the sweep are all equal: such scans are not deskewed");
    return false;
  }
  return true;
}

FrontendOutput Frontend::Impl::process(const Scan& scan) {
  Stopwatch clock;
  scan_.sequence = scan.sequence;
  scan_.utime = scan.utime_end();
  scan_.duration_us = scan.duration_us;
  scan_.n_points = static_cast<int>(scan.size());
  preprocessor_.run(scan, usable_times(scan), parallel_, scan_.cloud);
  scan_.preprocess_ms = clock.lap_ms();
  const bool was_at_start = track_.at_start();
  FrontendOutput out = track_.process(scan_, parallel_, remarks_, start_.open());
  follow_start(was_at_start, out);
  return out;
}

// While the speed at a start is not settled the submap stays open: once it is cut its scans are final, and
// the state that is saved then knows of no search.
void Frontend::Impl::follow_start(bool was_at_start, FrontendOutput& out) {
  if (config_.mode != "robust") return;
  if (track_.at_start() && !was_at_start) {
    start_.begin(track_);
    start_results_.assign(1, out.odometry);
    return;
  }
  if (out.finished_submap) start_.end();
  if (!start_.open()) return;
  start_results_.push_back(out.odometry);
  if (!start_.add(scan_, out.odometry.state, track_)) return;
  Stopwatch clock;
  auto found = start_.find(track_, parallel_);
  const bool another = found.has_value();
  if (found) take_up(std::move(*found));
  const bool smoother = smooth_start();
  start_.end();
  out.odometry = start_results_.back();
  if (first_is_cut()) start_results_.erase(start_results_.begin());
  start_results_.pop_back();
  if (another || smoother) out.revised = std::move(start_results_);
  start_results_.clear();
  const float ms = clock.lap_ms();
  for (auto* d : {&out.odometry.diagnostics, &track_.builder().last_scan().diagnostics}) {
    d->ms[1] += ms;
    d->ms[5] += ms;
  }
}

// Goes on with another track through the same scans.
void Frontend::Impl::take_up(FoundStart found) {
  // What the scans took was measured when they came.
  for (std::size_t i = 0; i < found.results.size(); ++i) {
    OdometryResult& result = start_results_[i + 1];
    found.results[i].diagnostics.ms = result.diagnostics.ms;
    result = found.results[i];
  }
  auto& scans = found.track.builder().open_scans();
  const auto& said = track_.builder().open_scans();
  for (std::size_t i = 0; i < scans.size(); ++i) scans[i].diagnostics.ms = said[i].diagnostics.ms;
  if (found.moved) start_results_.front().odom_from_sensor = found.track.builder().odom_from_submap();
  track_ = std::move(found.track);
  remarks_.add(
      "the sensor was moving when the first scan was taken, and how fast shows only now: the way since then "
      "has "
      "been estimated anew");
}

// At the start of the session only: after a loss the first pose is the last one of a submap that is stored.
bool Frontend::Impl::smooth_start() {
  SubmapBuilder& builder = track_.builder();
  if (builder.id() != 0 || builder.open_scans().size() != start_results_.size()) return false;
  std::vector<Pose> poses;
  for (const OdometryResult& r : start_results_) poses.push_back(r.odom_from_sensor);
  poses = start_.smoothed(poses, parallel_);
  if (poses.empty()) return false;
  builder.move_scans(poses);
  const Pose submap_from_odom = builder.odom_from_submap().inverse();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    start_results_[i].odom_from_sensor = poses[i];
    start_results_[i].submap_from_sensor = submap_from_odom * poses[i];
  }
  return true;
}

std::vector<std::uint8_t> Frontend::Impl::save_state() const {
  std::vector<std::uint8_t> bytes;
  bytes.reserve(4096);
  ByteWriter out(bytes);
  out.put(kStateVersion);
  out.put(config_.voxel_size_m);
  out.put(config_.max_points_per_voxel);
  out.put(remarks_.said());
  track_.save(out);
  return bytes;
}

void Frontend::Impl::restore_state(const std::vector<std::uint8_t>& state) {
  ByteReader in(state.data(), state.data() + state.size(), "the front-end's saved state");
  if (in.take<std::uint32_t>() != kStateVersion) in.fail("version");
  if (in.take<double>() != config_.voxel_size_m || in.take<int>() != config_.max_points_per_voxel) {
    throw Error("the session was made with another voxel size", "front-end's saved state",
                "Use the configuration that the session began with, or start a new session.");
  }
  remarks_.set_said(in.take<unsigned>());
  track_.load(in);
  if (in.left() != 0) in.fail("bytes are left over at its end");
  start_.end();
  if (!track_.at_start() || config_.mode != "robust") return;
  start_.begin(track_);
  start_results_.assign(1, {});  // of the scan that the last submap ends with: told already
}

Frontend::Frontend(const FrontendConfig& config, int threads)
    : impl_(std::make_unique<Impl>(config, threads)) {}
Frontend::~Frontend() = default;
Frontend::Frontend(Frontend&&) noexcept = default;
Frontend& Frontend::operator=(Frontend&&) noexcept = default;
FrontendOutput Frontend::process(const Scan& scan) { return impl_->process(scan); }
std::optional<Submap> Frontend::finish() { return impl_->finish(); }
std::vector<std::uint8_t> Frontend::save_state() const { return impl_->save_state(); }
void Frontend::restore_state(const std::vector<std::uint8_t>& state) { impl_->restore_state(state); }
std::vector<std::string> Frontend::take_warnings() { return impl_->take_warnings(); }

}  // namespace hp2
