// The odometry: one scan after the other is deskewed, registered to the local map, and added to it.
#pragma once
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
    if ((made_ >> bit & 1U) != 0) return;
    made_ |= 1U << bit;
    add(text);
  }
  void add(const std::string& text) { texts_.push_back(text); }
  std::vector<std::string> take() { return std::exchange(texts_, {}); }
  unsigned made() const { return made_; }
  void set_made(unsigned made) { made_ = made; }

 private:
  unsigned made_ = 0;
  std::vector<std::string> texts_;
};

/// What a scan is processed with.
struct TrackContext {
  const Parallel& parallel;
  Remarks& remarks;
  bool hold_submap = false;  ///< The open submap is not cut: its scans may get other poses.
};

/// Registers scans one after the other. Copies are independent of each other.
class Track {
 public:
  explicit Track(const FrontendConfig& config);

  FrontendOutput process(const StampedCloud& scan, const TrackContext& context);
  std::optional<Submap> finish() { return builder_.finish(); }

  /// True between a first scan, of the session or after a loss, and the second: the speed is unknown.
  bool at_start() const { return !first_cloud_.points.empty(); }
  /// The first scan, not deskewed, while at_start().
  const PreprocessedScan& first_cloud() const { return first_cloud_; }
  /// While at_start(): the sensor moved at `velocity` [twist / us] in the first scan, a sweep of
  /// `duration_us`.
  void start_with(const Vector6d& velocity, std::int64_t duration_us, const Parallel& parallel);
  /// True while the first scan of the session is the only one.
  bool begins_session() const { return builder_.id() == 0 && builder_.open_scans().size() == 1; }
  /// Rebuilds the map with voxels of other sizes; its points do not move.
  void set_sizes(const MapSizes& sizes);
  /// Moves the trajectory so far, the open submap and the map.
  void move(const Pose& by);

  std::int64_t last_utime() const { return motion_.last_utime(); }
  const Pose& last_pose() const { return motion_.last_pose(); }
  const SubmapBuilder& builder() const { return builder_; }
  SubmapBuilder& builder() { return builder_; }
  const MapSizes& sizes() const { return sizes_; }
  /// Of the last scan; empty if it was not registered.
  const IcpResult& last_registration() const { return registration_; }

  /// Right after a submap was cut only.
  void save(ByteWriter& out) const;
  void load(ByteReader& in);
  /// RMS distance of the last registered points [m]; 100 before the first.
  double mean_range_m() const { return seen_range_m_; }

 private:
  // What is known of a scan before it is registered.
  struct Expectation {
    Pose pose;                 // predicted, at the sweep's end
    double stretch = 1.0;      // MotionModel::stretch()
    double error_m = 0.0;      // expected of the prediction; sigma but for its upper bound
    double most_m = 0.0;       // upper bound of sigma
    double sigma_m = 0.0;      // of the registration
    bool after_gap = false;    // the motion so far gives no reliable prediction
    bool after_drops = false;  // scans are missing before this one
  };
  // State and covariance of a registered scan.
  struct Verdict {
    Pose pose;
    Matrix6d covariance = Matrix6d::Zero();  // of the registration
    TrackingState state = TrackingState::kTracking;
    bool registered = false;
    bool is_first = false, is_second = false;  // since the session's begin or a loss
  };
  using TurnedPoints = std::vector<std::pair<std::uint32_t, Eigen::Vector3f>>;

  // The steps of process(), in their order.
  Expectation expect(const StampedCloud& scan, Remarks& remarks) const;
  void deskew(const StampedCloud& scan, const Vector6d& sweep_twist, const Parallel& parallel);
  IcpResult register_scan(const StampedCloud& scan, const Expectation& expected, const Parallel& parallel);
  IcpResult deskew_again(IcpResult icp, const StampedCloud& scan, const Expectation& expected,
                         const Parallel& parallel);
  Verdict judge(const IcpResult& icp, const StampedCloud& scan, const Expectation& expected,
                const TrackContext& context);
  void learn_motion(const StampedCloud& scan, const Expectation& expected, Verdict& verdict);
  std::optional<Submap> extend_maps(const StampedCloud& scan, const Expectation& expected,
                                    const Verdict& verdict, ScanPose& entry, std::int64_t skipped,
                                    const TrackContext& context);
  void describe(const StampedCloud& scan, const Expectation& expected, const Verdict& verdict,
                OdometryResult& out) const;
  // guesses.cpp
  IcpResult try_other_guesses(const IcpResult& icp, const StampedCloud& scan, const Expectation& expected,
                              const Parallel& parallel);
  bool is_lost(IcpResult& icp, const StampedCloud& scan, const Expectation& expected,
               const TrackContext& context);
  void begin_anew(const StampedCloud& scan);
  IcpResult register_second(const StampedCloud& scan, double sigma_m, const Parallel& parallel);

  LocalMap new_map() const;
  double submap_length_m() const;

  FrontendConfig config_;
  RobustConfig robust_;
  MapSizes sizes_;
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
  PreprocessedScan first_cloud_;  // of the first scan, until the second gives the sensor's speed
  IcpResult registration_;

  // Kept from scan to scan for their memory: the present scan's points as deskewed, those to register, and
  // how.
  std::vector<Eigen::Vector3f> points_, source_;
  SweepMotion sweep_;
  TurnedPoints turned_;
};

/// Points of a scan moved to the sweep's end for a motion of `sweep_twist` in it; as they are without times.
void deskew_points(const PreprocessedScan& cloud, const Vector6d& sweep_twist, const Parallel& parallel,
                   std::vector<Eigen::Vector3f>& out);

}  // namespace hp2
