// Constant-velocity prediction on real time stamps (DESIGN: a dropped scan or an uneven clock must not break
// it).
#pragma once
#include <cstdint>

#include "common/byte_io.hpp"
#include "common/geometry/pose.hpp"

namespace hp2 {

/// Last pose and velocity of the sensor.
class MotionModel {
 public:
  /// Pose expected at `utime` [us]; identity before the first pose.
  Pose predict(std::int64_t utime) const;
  /// Motion during a sweep of `duration_us`, as a twist; zero before there is a velocity.
  Vector6d sweep_twist(std::int64_t duration_us) const;
  /// The same, were the sensor at `pose` at `utime`.
  Vector6d sweep_twist(std::int64_t duration_us, const Pose& pose, std::int64_t utime) const;
  /// True if `utime` does not lie after the last pose's.
  bool time_is_broken(std::int64_t utime) const { return has_pose_ && utime <= last_utime_; }
  /// The registered pose at `utime` [us].
  void add(const Pose& pose, std::int64_t utime);

  const Pose& last_pose() const { return last_; }
  bool has_pose() const { return has_pose_; }

  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  std::int64_t interval_us(std::int64_t utime) const;

  Pose last_;
  Vector6d motion_ = Vector6d::Zero();  // twist over interval_ [us]
  std::int64_t interval_ = 100000;
  std::int64_t last_utime_ = 0;
  bool has_pose_ = false, has_motion_ = false;
};

}  // namespace hp2
