// Constant-velocity prediction on real time stamps (DESIGN: a dropped scan or an uneven clock must not break
// it).
#pragma once
#include <algorithm>
#include <cstdint>

#include "common/byte_io.hpp"
#include "common/geometry/pose.hpp"
#include "frontend/odometry/motion_filter.hpp"

namespace hp2 {

/// How the motion has changed from one interval to the next, as twists over a sweep.
struct Unevenness {
  Vector6d change = Vector6d::Zero();  ///< Of the motion; all of it where none was known before.
  Vector6d jerk = Vector6d::Zero();    ///< Of that change.
};

/// How the points of a scan were deskewed.
struct SweepMotion {
  Vector6d twist = Vector6d::Zero();  ///< Motion of the sensor during the sweep.
  std::int64_t duration_us = 0;       ///< Of the sweep; 0: the points have no times.
};

/// Last pose and velocity of the sensor.
class MotionModel {
 public:
  /// Pose expected at `utime` [us]; identity before the first pose.
  Pose predict(std::int64_t utime) const;
  /// Where the sensor may be if not at predict(): one usual step farther whatever the time stamps say
  /// (keyframes come by distance), looking ahead as before, and tilted as it is on average.
  Pose usual_step() const;
  /// Motion expected during the sweep of `duration_us` that ends at `utime`, as a twist; zero before there is
  /// a velocity.
  Vector6d sweep_twist(std::int64_t duration_us, std::int64_t utime) const;
  /// The same, were the sensor at `pose` at `utime`.
  Vector6d sweep_twist(std::int64_t duration_us, const Pose& pose, std::int64_t utime) const;
  /// The same, with the velocity filtered, were the sensor at `pose` at `utime`, registered so with
  /// `covariance` (sensor's axes) from points that were deskewed as `sweep` says.
  Vector6d sweep_twist(const SweepMotion& sweep, const Pose& pose, const Matrix6d& covariance,
                       std::int64_t utime) const;
  /// Length of a sweep over the time from the last pose to `utime`.
  double sweep_share(std::int64_t duration_us, std::int64_t utime) const {
    return static_cast<double>(duration_us) / static_cast<double>(interval_us(utime));
  }
  /// Time from the last pose to `utime` [us]; where the stamps are invalid, as long as the interval before.
  std::int64_t interval_us(std::int64_t utime) const;
  /// That time over the interval before.
  double interval_ratio(std::int64_t utime) const {
    return static_cast<double>(interval_us(utime)) / static_cast<double>(interval_);
  }
  /// How much farther off the prediction for `utime` may be than one from scan to scan at 10 Hz, for the same
  /// acceleration: it acts from the middle of the interval before on.
  double stretch(std::int64_t utime) const {
    constexpr double kUnit = 1e5, kLeast = 0.25,
                     kMost = 1e4;  // [us]; stamps that nearly coincide give no interval
    const double dt = static_cast<double>(interval_us(utime)) / kUnit;
    return std::clamp(0.5 * dt * (dt + static_cast<double>(interval_) / kUnit), kLeast, kMost);
  }
  /// True if `utime` does not lie after the last pose's.
  bool time_is_broken(std::int64_t utime) const { return has_pose_ && utime <= last_utime_; }
  /// True if too much time has passed since the last pose for a prediction at `utime`: more than a second,
  /// and more than three times the usual interval.
  bool is_gap(std::int64_t utime) const {
    constexpr std::int64_t kSecond = 1'000'000;
    const std::int64_t dt = interval_us(utime);
    return has_motion_ && dt > kSecond && dt / 3 > interval_;  // no product: a damaged state's may overflow
  }
  /// True for the first ten poses of the session, or after a loss.
  bool is_new() const { return poses_ < 10; }
  /// Forgets the motion and its statistics: the next pose is a first one.
  void restart() {
    has_pose_ = has_motion_ = has_change_ = false;
    change_.setZero();
    jerk_.setZero();
    poses_ = 0;
  }
  /// The sensor moves at `velocity` [twist / us].
  void start(const Vector6d& velocity);
  /// Moves the frame of the poses.
  void move(const Pose& by) {
    last_ = by * last_;
    filter_.move(by);
    usual_up_ = last_.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  }
  /// The pose at `utime` [us], whose points were deskewed as `sweep` says; the velocity is that from the pose
  /// before.
  void add(const Pose& pose, std::int64_t utime, const SweepMotion& sweep);
  /// The same, with the velocity filtered.
  /// @param covariance of the registration (sensor's axes); null: the pose is a guess
  void add_filtered(const Pose& pose, std::int64_t utime, const SweepMotion& sweep,
                    const Matrix6d* covariance);
  /// How far the last pose was from the expected one: its squared error over what was expected of it, 1 in
  /// the mean.
  double surprise() const { return has_motion_ ? filter_.surprise() : 0.0; }
  /// The same, were the sensor at `pose` at `utime`, at the end of a sweep of `duration_us`; 0 before there
  /// is a velocity. A pose counts as exact to a decimetre and a degree.
  double surprise_at(const Pose& pose, std::int64_t utime, std::int64_t duration_us) const;
  /// Motion from the pose before the last one to the last one.
  Pose last_step() const { return se3_exp(motion_); }

  /// How unevenly the sensor moved to the last pose; a sweep of unknown length (0) lasts as long as the
  /// interval.
  Unevenness unevenness(std::int64_t duration_us) const;

  const Pose& last_pose() const { return last_; }
  std::int64_t last_utime() const { return last_utime_; }
  bool has_pose() const { return has_pose_; }

  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  // From the last pose and the motion to it.
  void start_filter(const Vector6d& sweep_twist);
  // Time from the middle of the last sweep to that of one that ends at `utime` [s].
  double to_middle_s(std::int64_t utime, std::int64_t duration_us) const;

  Pose last_;
  MotionFilter filter_;
  std::int64_t last_duration_ = 0;      // of the last sweep [us]
  Vector6d motion_ = Vector6d::Zero();  // twist over interval_ [us]
  // Running means: translation from pose to pose [m], and the map's z axis in the sensor's frame.
  Eigen::Vector3d usual_translation_ = Eigen::Vector3d::Zero(), usual_up_ = Eigen::Vector3d::UnitZ();
  Vector6d change_ = Vector6d::Zero(), jerk_ = Vector6d::Zero();  // of the velocity [twist / us]
  std::int64_t interval_ = 100000;
  std::int64_t last_utime_ = 0;
  bool has_pose_ = false, has_motion_ = false, has_change_ = false;
  int poses_ = 0;  // since the session's begin or a loss, at most ten
};

}  // namespace hp2
