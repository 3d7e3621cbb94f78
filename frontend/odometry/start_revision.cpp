#include "frontend/odometry/start_revision.hpp"

#include <utility>

namespace hp2 {
namespace {

constexpr int kSearchSteps = 6;         // per scan
constexpr std::size_t kScansAgain = 3;  // per scan, until the new estimate has caught up

}  // namespace

void StartRevision::begin(const Track& followed, const OdometryResult& first) {
  end();
  base_ = followed;
  StampedCloud& scan = scans_.emplace_back();
  scan.cloud = followed.first_cloud();
  scan.utime = followed.last_utime();
  results_.push_back(first);
}

void StartRevision::end() {
  base_.reset();
  search_.reset();
  other_.reset();
  scans_.clear();
  results_.clear();
  other_results_.clear();
  eigenvalue_ratios_.clear();
  information_.setZero();
}

void StartRevision::add(const StampedCloud& scan, const OdometryResult& result, const Track& followed) {
  if (scans_.size() == 1) scans_.front().duration_us = scan.duration_us;
  scans_.push_back(scan);
  results_.push_back(result);
  if (search_) return;
  const IcpResult& icp = followed.last_registration();
  if (icp.n_planar + icp.n_non_planar > 0) {
    information_ += icp.information;
    eigenvalue_ratios_.push_back(icp.min_eigenvalue_ratio);
  }
  if (scans_.size() >= config_.scans) begin_search(followed);
}

void StartRevision::begin_search(const Track& followed) {
  std::vector<ThinScan> thin;
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < scans_.size(); ++i) {
    const PreprocessedScan& cloud = scans_[i].cloud;
    ThinScan& t = thin.emplace_back(
        thinned(cloud.points, cloud.time, cloud.source, config_.points, config_.map_points));
    t.utime = scans_[i].utime;
    t.duration_us = scans_[i].duration_us;
    poses.push_back(results_[i].odom_from_sensor);
  }
  if (!StartSearch::worthwhile(config_, thin, eigenvalue_ratios_)) return end();
  search_.emplace(config_, icp_, followed.sizes().voxel_m, followed.sizes().spacing_m, std::move(thin),
                  std::move(poses), information_);
}

std::optional<RevisedStart> StartRevision::work(const Track& followed, const Parallel& parallel) {
  if (other_) return catch_up(followed, parallel);
  if (!search_ || !search_->work(kSearchSteps, parallel)) return std::nullopt;
  if (!search_->found()) {
    end();
    return std::nullopt;
  }
  other_ = *base_;
  other_->start_with(*search_->found(), scans_[1].duration_us, parallel);
  other_results_.assign(1, results_.front());
  return std::nullopt;
}

std::optional<RevisedStart> StartRevision::catch_up(const Track& followed, const Parallel& parallel) {
  Remarks ignored;  // the followed track has reported them
  for (std::size_t k = 0; k < kScansAgain && other_results_.size() < scans_.size(); ++k) {
    const std::size_t i = other_results_.size();
    OdometryResult result = other_->process(scans_[i], {parallel, ignored, true}).odometry;
    if (result.state == TrackingState::kLost && results_[i].state != TrackingState::kLost) {
      end();
      return std::nullopt;
    }
    result.diagnostics.ms = results_[i].diagnostics.ms;  // the scan's times were measured when it arrived
    other_results_.push_back(result);
  }
  if (other_results_.size() < scans_.size()) return std::nullopt;
  RevisedStart out{std::move(*other_), std::move(other_results_), base_->begins_session()};
  for (std::size_t i = 0; i < out.track.builder().open_scans().size(); ++i) {
    const std::size_t k = results_.size() - out.track.builder().open_scans().size() + i;
    out.track.builder().open_scans()[i].diagnostics.ms = results_[k].diagnostics.ms;
  }
  if (out.moved) {
    const Pose by = followed.last_pose() * out.track.last_pose().inverse();
    out.track.move(by);
    for (OdometryResult& r : out.results) r.odom_from_sensor = by * r.odom_from_sensor;
    out.results.front().odom_from_sensor = out.track.builder().odom_from_submap();
  }
  end();
  return out;
}

}  // namespace hp2
