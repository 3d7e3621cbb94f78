#include "frontend/frontend.hpp"

#include <string>
#include <utility>

#include "common/byte_io.hpp"
#include "common/error.hpp"
#include "common/registration/stopwatch.hpp"
#include "frontend/odometry/start_revision.hpp"
#include "frontend/odometry/track.hpp"

namespace hp2 {
namespace {

constexpr std::uint32_t kStateVersion = 10;
constexpr unsigned kOtherSensor = 6;  // remark; those of Track come before it

}  // namespace

class Frontend::Impl {
 public:
  Impl(const FrontendConfig& config, int threads)
      : config_(config),
        robust_(robust_parts(config)),
        correction_(config.sensor),
        parallel_(threads),
        preprocessor_({config.min_range_m, config.max_range_m}),
        track_(config),
        start_(StartSearchConfig(), icp_config(config)) {
    validate(config);
    use_sizes(map_sizes(config, scale_.voxel_m()));
  }

  FrontendOutput process(const Scan& scan) {
    return correction_.corrects() ? process_corrected(corrected(scan)) : process_corrected(scan);
  }
  std::optional<Submap> finish() {
    start_.end();
    return track_.finish();
  }
  std::vector<std::uint8_t> save_state() const;
  void restore_state(const std::vector<std::uint8_t>& state);
  std::vector<std::string> take_warnings() { return remarks_.take(); }

 private:
  FrontendOutput process_corrected(const Scan& scan);
  const Scan& corrected(const Scan& scan);
  bool usable_times(const Scan& scan);
  void use_sizes(const MapSizes& sizes) {
    preprocessor_.set_voxels(sizes.map_point_m, sizes.source_voxel_m);
    track_.set_sizes(sizes);
  }
  void revise_start(bool was_at_start, FrontendOutput& out);
  void take_up(RevisedStart revised, FrontendOutput& out);

  FrontendConfig config_;
  RobustConfig robust_;
  SensorCorrection correction_;
  Scan corrected_;  // kept from scan to scan for its memory
  Parallel parallel_;
  Preprocessor preprocessor_;
  MapScale scale_;
  Track track_;
  StartRevision start_;
  bool first_is_cut_ = false;  // `start_` begins with the last scan of the submap before
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

const Scan& Frontend::Impl::corrected(const Scan& scan) {
  constexpr double kFewOnRings = 0.7;
  corrected_ = scan;
  if (correction_.apply(corrected_) < kFewOnRings)
    remarks_.once(kOtherSensor,
                  "many points lie on no ring of sensor.ring_angles_deg: the calibration is that of another "
                  "sensor, or the scans are motion-compensated. Give that of this sensor");
  return corrected_;
}

FrontendOutput Frontend::Impl::process_corrected(const Scan& scan) {
  Stopwatch clock;
  scan_.sequence = scan.sequence;
  scan_.utime = scan.utime_end();
  scan_.duration_us = scan.duration_us;
  scan_.n_points = static_cast<int>(scan.size());
  // The map's voxels do not change while the first scans may be registered again.
  if (robust_.map_scale && !start_.open() && !track_.at_start()) {
    scale_.add(scan, config_.min_range_m, config_.max_range_m, track_.mean_range_m());
    use_sizes(map_sizes(config_, scale_.voxel_m()));
  }
  preprocessor_.run(scan, usable_times(scan), parallel_, scan_.cloud);
  scan_.preprocess_ms = clock.lap_ms();
  const bool was_at_start = track_.at_start();
  FrontendOutput out = track_.process(scan_, {parallel_, remarks_, start_.open()});
  revise_start(was_at_start, out);
  return out;
}

// While the speed of the first scans is not settled the submap stays open: cutting it makes its scans final,
// and the saved state has no search in it.
void Frontend::Impl::revise_start(bool was_at_start, FrontendOutput& out) {
  if (!robust_.start_search) return;
  if (track_.at_start() && !was_at_start) {
    start_.begin(track_, out.odometry);
    first_is_cut_ = out.finished_submap.has_value();
    return;
  }
  if (out.finished_submap) start_.end();
  if (!start_.open()) return;
  Stopwatch clock;
  start_.add(scan_, out.odometry, track_);
  if (auto revised = start_.work(track_, parallel_)) take_up(std::move(*revised), out);
  const float ms = clock.lap_ms();
  for (auto* d : {&out.odometry.diagnostics, &track_.builder().last_scan().diagnostics}) {
    d->ms[1] += ms;
    d->ms[5] += ms;
  }
}

// Continues with another track through the same scans.
void Frontend::Impl::take_up(RevisedStart revised, FrontendOutput& out) {
  track_ = std::move(revised.track);
  out.odometry = revised.results.back();
  revised.results.pop_back();
  // After a loss the first scan ended the submap before, which is stored.
  if (first_is_cut_) revised.results.erase(revised.results.begin());
  out.revised = std::move(revised.results);
  remarks_.add(
      "the sensor was moving when the first scan was taken, and how fast shows only now: the trajectory "
      "since "
      "then has been estimated again");
}

std::vector<std::uint8_t> Frontend::Impl::save_state() const {
  std::vector<std::uint8_t> bytes;
  bytes.reserve(4096);
  ByteWriter out(bytes);
  out.put(kStateVersion);
  out.put(config_.voxel_size_m);
  out.put(config_.max_points_per_voxel);
  scale_.save(out);
  out.put(remarks_.made());
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
  scale_.load(in);
  use_sizes(map_sizes(config_, scale_.voxel_m()));
  remarks_.set_made(in.take<unsigned>());
  track_.load(in);
  if (in.left() != 0) in.fail("bytes are left over at its end");
  start_.end();
  if (!track_.at_start() || !robust_.start_search) return;
  OdometryResult first;  // of the scan that the last submap ends with, which is reported already
  first.odom_from_sensor = track_.last_pose();
  start_.begin(track_, first);
  first_is_cut_ = true;
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
