// The speed of the first scans where it is weakly observed. On a bridge or a highway they fit a standing
// sensor, or one that follows the traffic, about as well as the true motion. The map made with a wrong speed
// then confirms it. So the first scans are registered again, thinned out, for a range of starting speeds. The
// true one gives a smooth trajectory that the scans agree with. The work is cut into small steps, so that no
// scan waits for it.
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"
#include "frontend/odometry/adaptive_scale.hpp"

namespace hp2 {

/// A scan thinned out for the search.
struct ThinScan {
  std::vector<Eigen::Vector3f>
      points;                ///< Sensor frame at the firing instant [m]: those to register, then ...
  std::size_t n_source = 0;  ///< ... from here on those for the map.
  std::vector<float> time;   ///< In the sweep, per point; empty: absent.
  std::int64_t utime = 0;    ///< End of the sweep [us].
  std::int64_t duration_us = 0;
};

/// Settings of the search.
struct StartSearchConfig {
  std::size_t scans = 12;          ///< That decide.
  std::size_t screening = 5;       ///< After so many the unlikely candidates are given up.
  std::size_t finalists = 4;       ///< Candidates that see all scans.
  std::size_t points = 2500;       ///< To register, per scan.
  std::size_t map_points = 20000;  ///< For the map, per scan.
  int iterations = 10;             ///< Per registration: from a wrong speed it would go on for long.
  double spacing_m = 0.5;          ///< Per scan interval, from candidate to candidate.
  int steps_aside = 8;             ///< Candidates to each side of standing still.
  double doubtful_ratio = 0.075;   ///< Median smallest eigenvalue ratio below which the search begins.
  double sigma_m = 0.6;     ///< First scale of the robust loss: ICP reaches the speeds between candidates.
  double roughness = 0.05;  ///< Weight of the logarithm of the RMS change of velocity.
  double noise_m_s = 0.35;  ///< Changes of velocity below this are registration's noise.
  double clearly = 0.009;   ///< The best one must be better than the followed trajectory by this.
  double most_rough_m_s = 2.0;  ///< A trajectory with larger changes of velocity is implausible.
  double apart_m = 0.5;         ///< The best one must deviate from it by this somewhere.
};

/// Searches the starting speed. Values in, steps of work, a velocity out; the result depends on the scans
/// alone.
class StartSearch {
 public:
  /// @param icp   settings of the registration
  /// @param scans at least three, of increasing time
  /// @param followed poses of the same scans as first estimated
  /// @param information sum of their registrations' information, for the weakly observed direction
  StartSearch(const StartSearchConfig& config, const IcpConfig& icp, double voxel_m, double spacing_m,
              std::vector<ThinScan> scans, std::vector<Pose> followed, const Matrix6d& information);

  /// True where most scans have a weakly observed direction and come at even times, so that a search makes
  /// sense.
  static bool worthwhile(const StartSearchConfig& config, const std::vector<ThinScan>& scans,
                         std::vector<double> eigenvalue_ratios);

  /// Does one registration per unit of `steps`. @return true when the search is done
  bool work(int steps, const Parallel& parallel);
  /// Once it is done: the velocity of the sensor in the first scan [twist / us], if another one than followed
  /// fits the scans clearly better.
  std::optional<Vector6d> found() const { return found_; }

 private:
  struct Candidate {
    Vector6d velocity = Vector6d::Zero();  // to begin with [twist / us]
    std::optional<LocalMap> map;
    std::optional<AdaptiveScale> scale;
    std::vector<Pose> poses;
    Vector6d last_velocity = Vector6d::Zero();
    double agreement = 0.0;  // sum
    bool lost = false;
  };

  void register_next(Candidate& c, const Parallel& parallel);
  double interval_us(std::size_t i) const {
    return static_cast<double>(scans_[i].utime - scans_[i - 1].utime);
  }
  double roughness_m_s(const std::vector<Pose>& poses) const;
  double score(const Candidate& c) const;
  double distance_m(const std::vector<Pose>& a, const std::vector<Pose>& b) const;
  bool same(const Candidate& a, const Candidate& b) const;
  Vector6d later_velocity(const std::vector<Pose>& poses) const;
  void add_candidate(const Vector6d& velocity) { candidates_.emplace_back().velocity = velocity; }
  void next_round();
  void decide();

  StartSearchConfig config_;
  HybridIcp icp_;
  double voxel_m_, spacing_m_;
  std::vector<ThinScan> scans_;
  std::vector<Pose> followed_;
  Eigen::Vector3d direction_;  // weakly observed, sensor frame of the first scan
  double usual_interval_ = 1.0;
  std::vector<Candidate> candidates_;
  std::size_t at_ = 0;  // candidate under way
  enum class Round { kScreening, kFinal, kAgain, kDone } round_ = Round::kScreening;
  std::optional<Vector6d> found_;
};

/// Some `count` of a scan's chosen points to register, and some `map_count` of all for the map.
ThinScan thinned(const std::vector<Eigen::Vector3f>& points, const std::vector<float>& time,
                 const std::vector<std::uint32_t>& chosen, std::size_t count, std::size_t map_count);

}  // namespace hp2
