#include "frontend/odometry/motion_filter.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Cholesky>

namespace hp2 {
namespace {

// Of translations and rotations. Found on simulated drives of cars, of a walker in a corridor and of a UAV; a
// factor of two changes little.
struct Kind {
  double acceleration;       // its deviation [m/s^2, rad/s^2] ...
  double lasts_s;            // ... and the time that it lasts
  double jolts;              // what changes the velocity at once: density [m^2/s^3, rad^2/s^3]
  double at_start, v_start;  // deviations of a first pose [m, rad] and of a first velocity [m/s, rad/s]
};
constexpr Kind kTranslation{2.0, 1.0, 0.5, 0.01, 2.0};
constexpr Kind kRotation{0.4, 0.5, 0.02, 0.001, 0.2};

const Kind& kind(int axis) { return axis < 3 ? kTranslation : kRotation; }

// What an acceleration adds to the velocity within `dt`, a unit of it, while it dies away.
double gain(const Kind& k, double dt) { return k.lasts_s * (1.0 - std::exp(-dt / k.lasts_s)); }

}  // namespace

void MotionFilter::start(const Pose& middle, const Vector6d& velocity) {
  middle_ = middle;
  velocity_ = velocity;
  acceleration_.setZero();
  covariance_.setZero();
  for (int i = 0; i < 6; ++i) {
    const Kind& k = kind(i);
    covariance_(i, i) = k.at_start * k.at_start;
    covariance_(6 + i, 6 + i) = k.v_start * k.v_start;
    covariance_(12 + i, 12 + i) = k.acceleration * k.acceleration;
  }
  surprise_ = 0.0;
}

Vector6d MotionFilter::velocity_after(double dt_s) const {
  Vector6d v = velocity_;
  for (int i = 0; i < 6; ++i) v[i] += gain(kind(i), dt_s) * acceleration_[i];
  return v;
}

MotionFilter MotionFilter::predicted(double dt) const {
  MotionFilter out = *this;
  Covariance move = Covariance::Identity(), noise = Covariance::Zero();
  const double dt2 = dt * dt, dt3 = dt2 * dt;
  Vector6d way;
  for (int i = 0; i < 6; ++i) {
    const Kind& k = kind(i);
    const double g = gain(k, dt), way_gain = k.lasts_s * (dt - g), keep = std::exp(-dt / k.lasts_s);
    way[i] = dt * velocity_[i] + way_gain * acceleration_[i];
    out.velocity_[i] = velocity_[i] + g * acceleration_[i];
    out.acceleration_[i] = keep * acceleration_[i];
    const int p = i, v = 6 + i, a = 12 + i;
    move(p, v) = dt;
    move(p, a) = way_gain;
    move(v, a) = g;
    move(a, a) = keep;
    // The acceleration's own noise for times that are short against its own; it is never more than itself.
    const double q = std::min(2.0 / k.lasts_s, 1.0 / dt) * k.acceleration * k.acceleration;
    noise(p, p) = k.jolts * dt3 / 3.0 + q * dt3 * dt2 / 20.0;
    noise(p, v) = noise(v, p) = k.jolts * dt2 / 2.0 + q * dt2 * dt2 / 8.0;
    noise(p, a) = noise(a, p) = q * dt3 / 6.0;
    noise(v, v) = k.jolts * dt + q * dt3 / 3.0;
    noise(v, a) = noise(a, v) = q * dt2 / 2.0;
    noise(a, a) = q * dt;
  }
  out.middle_ = middle_ * se3_exp(way);
  out.covariance_ = move * covariance_ * move.transpose() + noise;
  return out;
}

MotionFilter MotionFilter::measured(const Pose& middle, const Matrix6d& covariance, double dt_s) const {
  MotionFilter out = predicted(dt_s);
  const Vector6d innovation = se3_log(out.middle_.inverse() * middle);
  const Eigen::Matrix<double, 18, 6> cross = out.covariance_.leftCols<6>();
  const Eigen::LDLT<Matrix6d> expected(Matrix6d(cross.topRows<6>() + covariance));
  const Eigen::Matrix<double, 18, 6> weight = expected.solve(cross.transpose()).transpose();
  const Eigen::Matrix<double, 18, 1> change = weight * innovation;
  out.middle_ = out.middle_ * se3_exp(change.head<6>());
  out.velocity_ += change.segment<6>(6);
  out.acceleration_ += change.tail<6>();
  out.covariance_ -= weight * cross.transpose();
  out.covariance_ = 0.5 * (out.covariance_ + out.covariance_.transpose()).eval();
  out.surprise_ = innovation.dot(expected.solve(innovation)) / 6.0;
  return out;
}

MotionFilter MotionFilter::guessed(const Pose& middle, double dt_s) const {
  MotionFilter out = predicted(dt_s);
  out.middle_ = middle;
  out.surprise_ = 0.0;
  return out;
}

void MotionFilter::save(ByteWriter& out) const {
  out.put(middle_);
  out.put(velocity_);
  out.put(acceleration_);
  out.put(covariance_);
  out.put(surprise_);
}

void MotionFilter::load(ByteReader& in) {
  middle_ = in.take<Pose>();
  velocity_ = in.take<Vector6d>();
  acceleration_ = in.take<Vector6d>();
  covariance_ = in.take<Covariance>();
  surprise_ = in.take<double>();
  constexpr double kMostMotion = 1e5, kMostVariance = 1e9;  // of any vehicle or person
  const auto below = [](const auto& m, double most) {
    return m.allFinite() && m.cwiseAbs().maxCoeff() < most;
  };
  if (!below(velocity_, kMostMotion) || !below(acceleration_, kMostMotion) ||
      !below(covariance_, kMostVariance) || covariance_.diagonal().minCoeff() < 0.0 || !(surprise_ >= 0.0))
    in.fail("motion filter");
}

}  // namespace hp2
