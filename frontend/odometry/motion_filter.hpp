// How the sensor moves, from registered poses: a Kalman filter, so that the noise of a pose does not become
// the deskewing of the next sweep.
#pragma once
#include "common/byte_io.hpp"
#include "common/geometry/pose.hpp"

namespace hp2 {

/// Pose, velocity and acceleration of the sensor at the middle of a sweep. Velocity [m/s, rad/s] and
/// acceleration are twists in the sensor's axes; the acceleration dies away within a second or so and is
/// renewed at random (R. A. Singer, "Estimating optimal tracking filter performance for manned maneuvering
/// targets", 1970).
///
/// It is the middle's pose that a registration measures: deskewed with a velocity that is too high a sweep's
/// end comes out too far ahead and its begin too far behind. A velocity from ends would feed its own error
/// back, from scan to scan with alternating sign.
class MotionFilter {
 public:
  /// Nothing is known but the pose and a rough velocity [m/s, rad/s].
  void start(const Pose& middle, const Vector6d& velocity);
  /// Velocity expected `dt_s` later.
  Vector6d velocity_after(double dt_s) const;
  /// The filter `dt_s` later, when the middle's pose was measured with `covariance` (sensor's axes).
  MotionFilter measured(const Pose& middle, const Matrix6d& covariance, double dt_s) const;
  /// The filter `dt_s` later, at a pose that nobody measured.
  MotionFilter guessed(const Pose& middle, double dt_s) const;
  /// Moves the frame of the poses.
  void move(const Pose& by) { middle_ = by * middle_; }

  const Vector6d& velocity() const { return velocity_; }
  /// How far the last pose was from the expected one: its squared error over what was expected of it, 1 in
  /// the mean.
  double surprise() const { return surprise_; }

  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  using Covariance = Eigen::Matrix<double, 18, 18>;  // of pose, velocity, acceleration

  MotionFilter predicted(double dt_s) const;

  Pose middle_;
  Vector6d velocity_ = Vector6d::Zero(), acceleration_ = Vector6d::Zero();
  Covariance covariance_ = Covariance::Zero();
  double surprise_ = 0.0;
};

}  // namespace hp2
