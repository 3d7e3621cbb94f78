// One estimate of the sensor's way: a local map, a motion model and the open submap. The front-end follows
// one; at a doubtful start it tries others as well (start_search.hpp).
#pragma once
#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"
#include "common/registration/parallel.hpp"
#include "frontend/frontend.hpp"
#include "frontend/odometry/adaptive_scale.hpp"
#include "frontend/odometry/motion_model.hpp"
#include "frontend/odometry/preprocess.hpp"
#include "frontend/odometry/submap_builder.hpp"

namespace hp2 {

/// A scan as a Track is given it.
struct StampedCloud {
  PreprocessedScan cloud;
  std::int64_t sequence = 0;
  std::int64_t utime = 0;        ///< End of the sweep [us].
  std::int64_t duration_us = 0;  ///< Of the sweep; 0: unknown.
  int n_points = 0;              ///< In the scan as received.
  double preprocess_ms = 0.0;
};

/// Remarks that are made once.
class Remarks {
 public:
  void once(unsigned bit, const std::string& text) {
    if ((said_ >> bit & 1U) != 0) return;
    said_ |= 1U << bit;
    add(text);
  }
  void add(const std::string& text) { texts_.push_back(text); }
  std::vector<std::string> take() { return std::exchange(texts_, {}); }
  unsigned said() const { return said_; }
  void set_said(unsigned said) { said_ = said; }

 private:
  unsigned said_ = 0;
  std::vector<std::string> texts_;
};

/// Registers scans one after the other. Copies are independent of each other.
class Track {
 public:
  explicit Track(const FrontendConfig& config)
      : config_(config),
        map_(config.voxel_size_m, config.max_points_per_voxel, config.min_spacing_m),
        icp_(icp_config(config)),
        scale_(config.initial_sigma_m, config.min_sigma_m, config.sigma_window),
        builder_(config.submap_voxel_m) {}

  /// @param keep_open a start is being searched: the open submap is not cut unless a new start begins,
  ///                  agreement() is taken, and registration reaches far in few iterations
  FrontendOutput process(const StampedCloud& scan, const Parallel& parallel, Remarks& remarks,
                         bool keep_open);
  std::optional<Submap> finish() { return builder_.finish(); }

  /// True between a first scan, of the session or after a loss, and the second: the speed is unknown.
  bool at_start() const { return !first_cloud_.points.empty(); }
  /// At a start: the first scan, not deskewed.
  const PreprocessedScan& first_cloud() const { return first_cloud_; }
  /// At a start: the sensor moved at `velocity` [twist / us] in the first scan, in sweeps of `duration_us`.
  void start_with(const Vector6d& velocity, std::int64_t duration_us, const Parallel& parallel);
  /// Iterations of a registration at most, from now on, if the configuration does not allow fewer.
  void limit_iterations(int n) { icp_.set_max_iterations(std::min(n, config_.max_iterations)); }
  /// As many as the configuration allows.
  void lift_limit() { icp_.set_max_iterations(config_.max_iterations); }
  /// True while the first scan of the session is the only one.
  bool begins_session() const { return builder_.id() == 0 && builder_.open_scans().size() == 1; }
  /// Moves the whole way, the open submap and the map.
  void move(const Pose& by);

  const FrontendConfig& config() const { return config_; }
  std::int64_t last_utime() const { return motion_.last_utime(); }
  const Pose& last_pose() const { return motion_.last_pose(); }
  const SubmapBuilder& builder() const { return builder_; }
  SubmapBuilder& builder() { return builder_; }
  /// Of the last scan; empty if it was not registered.
  const IcpResult& last_registration() const { return last_registration_; }
  /// HybridIcp::agreement() of the last scan; 0 if it was not registered.
  double agreement() const { return agreement_; }

  /// Right after a submap was cut only.
  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  void deskew(const Vector6d& sweep_twist);
  void deskewed(const PreprocessedScan& cloud, const Vector6d& sweep_twist,
                std::vector<Eigen::Vector3f>& out) const;
  Vector6d better_sweep(const IcpResult& icp, double sigma, bool filtered) const;
  double submap_length_m() const;
  // track_guesses.cpp
  bool astray(double sigma, IcpResult& icp);
  void look_farther(IcpResult& icp, double sigma, const PosePrior& prior);
  void search_around(IcpResult& icp, double sigma, const PosePrior& prior);
  void begin_anew();
  IcpResult moving_start(double sigma);
  IcpResult settle_start(IcpResult icp, double sigma, HybridIcp& aligner);

  FrontendConfig config_;
  LocalMap map_;
  HybridIcp icp_;
  AdaptiveScale scale_;
  MotionModel motion_;
  SubmapBuilder builder_;
  std::int64_t last_sequence_ = -1;
  double seen_range_m_ = 100.0;  // RMS distance of the last registered points
  bool moved_ = false;
  double usual_fit_ = 1.0;                                // running mean of IcpResult::fit
  Eigen::Vector3d evicted_at_ = Eigen::Vector3d::Zero();  // where the map was last cut to its radius
  PreprocessedScan first_cloud_;  // of the first scan, until the second has told how fast the sensor was then
  IcpResult last_registration_;
  double agreement_ = 0.0;

  // Of the scan under way, and buffers kept from scan to scan.
  const StampedCloud* scan_ = nullptr;
  const Parallel* parallel_ = nullptr;
  Remarks* remarks_ = nullptr;
  std::vector<Eigen::Vector3f> points_, source_;
  SweepMotion sweep_;  // that they were deskewed with
  Vector6d predicted_sweep_ = Vector6d::Zero();
  std::vector<std::pair<std::uint32_t, Eigen::Vector3f>> turned_;  // HybridIcp::turned_points()
};

}  // namespace hp2
