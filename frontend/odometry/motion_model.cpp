#include "frontend/odometry/motion_model.hpp"

#include <algorithm>
#include <cmath>

namespace hp2 {
namespace {

// A step longer than this is no gap but another clock: a sensor's driver that took the place of a player,
// say. No motion can be predicted over a minute anyway.
constexpr std::int64_t kOtherClockUs = 60'000'000;
// Share of the last change of velocity that is expected to continue.
constexpr double kMostAcceleration = 0.5;

// Of two intervals one that is less than this share of the other is no measure of a velocity.
constexpr double kLeastShare = 0.25;

constexpr double kMicro = 1e-6;

}  // namespace

std::int64_t MotionModel::interval_us(std::int64_t utime) const {
  const std::int64_t dt = utime - last_utime_;
  return dt > 0 && dt < kOtherClockUs ? dt : interval_;
}

Pose MotionModel::predict(std::int64_t utime) const {
  if (!has_motion_) return last_;
  // The mean velocity of a motion is about that in its middle.
  const auto dt = static_cast<double>(interval_us(utime));
  const double to_its_middle = 0.5 * kMicro * (dt + static_cast<double>(last_duration_));
  return last_ * se3_exp(kMicro * dt * filter_.velocity_after(to_its_middle));
}

double MotionModel::to_middle_s(std::int64_t utime, std::int64_t duration_us) const {
  const auto dt = static_cast<double>(interval_us(utime));
  const double between = dt + 0.5 * static_cast<double>(last_duration_ - duration_us);
  return kMicro * std::max({between, kLeastShare * dt, kLeastShare * static_cast<double>(interval_)});
}

Pose MotionModel::usual_step() const {
  const Eigen::Vector3d up = last_.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  return last_ * Pose(Eigen::Quaterniond::FromTwoVectors(usual_up_, up), usual_translation_);
}

Vector6d MotionModel::sweep_twist(std::int64_t duration_us, std::int64_t utime) const {
  if (!has_motion_) return Vector6d::Zero();
  return kMicro * static_cast<double>(duration_us) * filter_.velocity_after(to_middle_s(utime, duration_us));
}

Vector6d MotionModel::sweep_twist(std::int64_t duration_us, const Pose& pose, std::int64_t utime) const {
  if (!has_pose_) return Vector6d::Zero();
  const auto duration = static_cast<double>(duration_us), dt = static_cast<double>(interval_us(utime));
  const Vector6d velocity = se3_log(last_.inverse() * pose) / dt;
  if (!has_motion_ || !(dt > duration)) return duration * velocity;
  // After a dropped scan the sweep is only the last part of the interval: by then the velocity had changed
  // further from the mean one.
  const auto before = static_cast<double>(interval_);
  const double share = std::min(kMostAcceleration, (dt - duration) / (dt + before));
  return duration * (velocity + share * (velocity - motion_ / before));
}

Vector6d MotionModel::sweep_twist(const SweepMotion& sweep, const Pose& pose, const Matrix6d& covariance,
                                  std::int64_t utime) const {
  if (!has_pose_) return Vector6d::Zero();
  const auto duration = static_cast<double>(sweep.duration_us);
  if (!has_motion_)
    return duration / static_cast<double>(interval_us(utime)) * se3_log(last_.inverse() * pose);
  const MotionFilter now =
      filter_.measured(pose * se3_exp(-0.5 * sweep.twist), covariance, to_middle_s(utime, sweep.duration_us));
  return kMicro * duration * now.velocity();
}

void MotionModel::start(const Vector6d& velocity) {
  motion_ = static_cast<double>(interval_) * velocity;
  has_motion_ = true;
  start_filter(static_cast<double>(last_duration_) * velocity);
}

void MotionModel::start_filter(const Vector6d& sweep_twist) {
  filter_.start(last_ * se3_exp(-0.5 * sweep_twist), motion_ / (kMicro * static_cast<double>(interval_)));
}

void MotionModel::add_filtered(const Pose& pose, std::int64_t utime, const SweepMotion& sweep,
                               const Matrix6d* covariance) {
  if (!has_motion_) return add(pose, utime, sweep);
  const Pose middle = pose * se3_exp(-0.5 * sweep.twist);
  const double dt = to_middle_s(utime, sweep.duration_us);
  const MotionFilter filter =
      covariance != nullptr ? filter_.measured(middle, *covariance, dt) : filter_.guessed(middle, dt);
  add(pose, utime, sweep);
  filter_ = filter;
}

void MotionModel::add(const Pose& pose, std::int64_t utime, const SweepMotion& sweep) {
  constexpr double kMemory = 0.9;
  if (has_pose_) {
    const auto old_interval = static_cast<double>(interval_),
               new_interval = static_cast<double>(interval_us(utime));
    const Vector6d before = motion_ / std::max(old_interval, kLeastShare * new_interval);
    interval_ = interval_us(utime);
    motion_ = se3_log(last_.inverse() * pose);
    const Vector6d velocity = motion_ / std::max(new_interval, kLeastShare * old_interval);
    const Vector6d change = has_motion_ ? Vector6d(velocity - before) : velocity;
    jerk_ = has_change_ ? Vector6d(change - change_) : Vector6d::Zero();
    change_ = change;
    has_change_ = has_motion_;
    has_motion_ = true;
  }
  const Eigen::Vector3d up = pose.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  const double keep = has_pose_ ? kMemory : 0.0;
  if (has_pose_) {
    usual_translation_ =
        kMemory * usual_translation_ + (1.0 - kMemory) * (last_.inverse() * pose).translation;
  }
  usual_up_ = (keep * usual_up_ + (1.0 - keep) * up).normalized();
  last_ = pose;
  last_utime_ = utime;
  last_duration_ = sweep.duration_us;
  has_pose_ = true;
  poses_ = std::min(poses_ + 1, 10);
  if (has_motion_) start_filter(sweep.twist);
}

Unevenness MotionModel::unevenness(std::int64_t duration_us) const {
  const auto duration = static_cast<double>(duration_us > 0 ? duration_us : interval_);
  return {duration * change_, duration * jerk_};
}

double MotionModel::surprise_at(const Pose& pose, std::int64_t utime, std::int64_t duration_us) const {
  if (!has_motion_) return 0.0;
  constexpr double kTranslation = 0.1, kRotation = 0.02;  // [m], [rad]
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(kTranslation * kTranslation);
  covariance.diagonal().tail<3>().setConstant(kRotation * kRotation);
  const Vector6d sweep = sweep_twist(duration_us, pose, utime);
  return filter_.measured(pose * se3_exp(-0.5 * sweep), covariance, to_middle_s(utime, duration_us))
      .surprise();
}

void MotionModel::save(ByteWriter& out) const {
  out.put(last_);
  out.put(motion_);
  out.put(interval_);
  out.put(last_utime_);
  out.put(static_cast<std::uint8_t>(has_pose_));
  out.put(static_cast<std::uint8_t>(has_motion_));
  out.put(poses_);
  out.put(usual_translation_);
  out.put(usual_up_);
  out.put(change_);
  out.put(jerk_);
  out.put(static_cast<std::uint8_t>(has_change_));
  filter_.save(out);
  out.put(last_duration_);
}

void MotionModel::load(ByteReader& in) {
  last_ = in.take<Pose>();
  motion_ = in.take<Vector6d>();
  interval_ = in.take<std::int64_t>();
  last_utime_ = in.take<std::int64_t>();
  has_pose_ = in.take<std::uint8_t>() != 0;
  has_motion_ = in.take<std::uint8_t>() != 0;
  poses_ = in.take<int>();
  usual_translation_ = in.take<Eigen::Vector3d>();
  usual_up_ = in.take<Eigen::Vector3d>();
  change_ = in.take<Vector6d>();
  jerk_ = in.take<Vector6d>();
  has_change_ = in.take<std::uint8_t>() != 0;
  filter_.load(in);
  last_duration_ = in.take<std::int64_t>();
  const bool changes = change_.allFinite() && jerk_.allFinite() && change_.norm() + jerk_.norm() < 1e6;
  const bool times =
      interval_ > 0 && interval_ < kOtherClockUs && last_duration_ >= 0 && last_duration_ <= kOtherClockUs;
  if (!times || !changes || !motion_.allFinite() || motion_.norm() > 1e6 || poses_ < 0) in.fail("motion");
  const bool up = std::abs(usual_up_.norm() - 1.0) < 1e-6;
  if (!usual_translation_.allFinite() || usual_translation_.norm() > 1e6 || !up) in.fail("usual step");
}

}  // namespace hp2
