// A start at unknown speed where hardly anything tells the speed: a bridge, a highway. The first scans then
// fit a standing sensor, or one that follows the traffic, about as well as the true motion, and the map that
// is made with a wrong speed confirms it. So the first scans are kept, and once there are enough of them they
// are registered again for a range of starting speeds. Of the ways that come out, the sensor took the one
// that is smooth and that the scans fit.
#pragma once
#include <cstddef>
#include <optional>
#include <vector>

#include "frontend/odometry/track.hpp"

namespace hp2 {

/// Another way through the first scans of a start.
struct FoundStart {
  Track track;
  std::vector<OdometryResult> results;  ///< What it says of each of them but the first.
  bool moved = false;  ///< The first one is elsewhere now: track.builder().odom_from_submap().
};

/// The first scans of a start, and the search for another way through them.
class StartSearch {
 public:
  /// @param followed is at_start(): the search begins from a copy of it
  void begin(const Track& followed);
  void end() { base_.reset(), scans_.clear(), followed_ = {}; }
  /// True from begin() to end().
  bool open() const { return base_.has_value(); }
  /// Another scan, which `followed` has just been given with this outcome. @return true if there are enough
  /// now
  bool add(const StampedCloud& scan, TrackingState state, const Track& followed);

  /// The track that explains the scans clearly better than the one followed, if there is one: it has been
  /// given all of them. At the start of a session its odometry ends at `followed.last_pose()`: the past is
  /// corrected, not the present. (After a loss the first pose stays, which was a guess, and the present
  /// moves.) Takes 0.3 to 2.5 s on two threads where the speed is doubtful, no time where it is not.
  std::optional<FoundStart> find(const Track& followed, const Parallel& parallel) const;
  /// smoothed_start() of the scans; empty where they do not come at even times.
  /// @param poses what is known of them by now
  std::vector<Pose> smoothed(const std::vector<Pose>& poses, const Parallel& parallel) const;

 private:
  // How a track went through the scans.
  struct Way {
    std::vector<Pose> poses;  // one a scan
    std::vector<TrackingState> states;
    std::vector<double> eigenvalue_ratios;  // of registered ones
    double agreement = 0.0;                 // sum of Track::agreement()
    Matrix6d information = Matrix6d::Zero();

    void add(const Track& track, TrackingState state);
  };
  struct Candidate {
    Vector6d velocity = Vector6d::Zero();  // to begin with [twist / us]
    std::optional<Track> track;
    std::vector<OdometryResult> results;
    Way way;
    bool lost = false;  // where the track that was followed was not
  };
  using Intervals = std::vector<double>;  // between the scans [us]

  double usual_interval() const;
  Intervals stamped() const;
  Intervals even() const;
  static double roughness(const Way& way, const Intervals& intervals);
  double score(const Way& way) const;
  double score(const Candidate& candidate) const;
  static double apart(const Way& a, const Way& b);
  bool even_times() const;
  bool doubtful() const;
  Eigen::Vector3d weak_direction() const;
  Vector6d better_velocity(const Way& way) const;
  void run(Candidate& candidate, std::size_t until, const Parallel& parallel) const;
  std::vector<Candidate> screen(const Parallel& parallel) const;

  std::optional<Track> base_;
  std::vector<StampedCloud> scans_;
  Way followed_;
};

}  // namespace hp2
