#include "frontend/motion_model.hpp"

namespace hp2 {
namespace {

// A step longer than this is no gap but another clock: a sensor's driver that took the place of a player, say. No motion
// can be predicted over a minute anyway.
constexpr std::int64_t kOtherClockUs = 60'000'000;

}  // namespace

// Time since the last pose; where the stamps make no sense, as long as the interval before.
std::int64_t MotionModel::interval_us(std::int64_t utime) const {
  const std::int64_t dt = utime - last_utime_;
  return dt > 0 && dt < kOtherClockUs ? dt : interval_;
}

Pose MotionModel::predict(std::int64_t utime) const {
  if (!has_motion_) return last_;
  const double ratio = static_cast<double>(interval_us(utime)) / static_cast<double>(interval_);
  return last_ * se3_exp(ratio * motion_);
}

Vector6d MotionModel::sweep_twist(std::int64_t duration_us) const {
  if (!has_motion_) return Vector6d::Zero();
  return (static_cast<double>(duration_us) / static_cast<double>(interval_)) * motion_;
}

Vector6d MotionModel::sweep_twist(std::int64_t duration_us, const Pose& pose, std::int64_t utime) const {
  if (!has_pose_) return Vector6d::Zero();
  return (static_cast<double>(duration_us) / static_cast<double>(interval_us(utime))) *
         se3_log(last_.inverse() * pose);
}

void MotionModel::add(const Pose& pose, std::int64_t utime) {
  if (has_pose_) {
    interval_ = interval_us(utime);
    motion_ = se3_log(last_.inverse() * pose);
    has_motion_ = true;
  }
  last_ = pose;
  last_utime_ = utime;
  has_pose_ = true;
}

void MotionModel::save(ByteWriter& out) const {
  out.put(last_);
  out.put(motion_);
  out.put(interval_);
  out.put(last_utime_);
  out.put(static_cast<std::uint8_t>(has_pose_));
  out.put(static_cast<std::uint8_t>(has_motion_));
}

void MotionModel::load(ByteReader& in) {
  last_ = in.take<Pose>();
  motion_ = in.take<Vector6d>();
  interval_ = in.take<std::int64_t>();
  last_utime_ = in.take<std::int64_t>();
  has_pose_ = in.take<std::uint8_t>() != 0;
  has_motion_ = in.take<std::uint8_t>() != 0;
  if (interval_ <= 0 || !motion_.allFinite() || motion_.norm() > 1e6) in.fail("motion");
}

}  // namespace hp2
