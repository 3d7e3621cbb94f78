// Re-estimates the first scans of a session, or after a loss, where their speed was in doubt. All work is
// done in small parts beside the scans that arrive meanwhile.
#pragma once
#include <optional>
#include <vector>

#include "frontend/odometry/start_search.hpp"
#include "frontend/odometry/track.hpp"

namespace hp2 {

/// Another estimate of all scans since the first one.
struct RevisedStart {
  Track track;
  std::vector<OdometryResult> results;  ///< One per scan since the first, which is the first entry.
  bool moved = false;                   ///< The first scan has another pose now: the present pose stays.
};

/// Collects the first scans, searches their speed (StartSearch), and registers them again from it.
class StartRevision {
 public:
  StartRevision(const StartSearchConfig& search, const IcpConfig& icp) : config_(search), icp_(icp) {}

  /// @param followed has just been given its first scan, with this outcome
  void begin(const Track& followed, const OdometryResult& first);
  void end();
  /// True from begin() until the scans are final: the submap stays open.
  bool open() const { return base_.has_value(); }
  /// Another scan, which `followed` has just been given with this outcome.
  void add(const StampedCloud& scan, const OdometryResult& result, const Track& followed);
  /// Does this scan's share of the work. @return the new estimate once it has come to the present scan
  std::optional<RevisedStart> work(const Track& followed, const Parallel& parallel);

 private:
  void begin_search(const Track& followed);
  std::optional<RevisedStart> catch_up(const Track& followed, const Parallel& parallel);

  StartSearchConfig config_;
  IcpConfig icp_;
  std::optional<Track> base_;        // before the second scan
  std::vector<StampedCloud> scans_;  // whole, since the first
  std::vector<OdometryResult> results_;
  std::vector<double> eigenvalue_ratios_;
  Matrix6d information_ = Matrix6d::Zero();
  std::optional<StartSearch> search_;
  std::optional<Track> other_;  // registers the scans again
  std::vector<OdometryResult> other_results_;
};

}  // namespace hp2
