// Clouds with known geometry, and small helpers that the front-end's tests share.
#pragma once
#include <cstdint>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "common/error.hpp"
#include "common/geometry/pose.hpp"
#include "common/scan.hpp"

namespace hp2::test {

using Cloud = std::vector<Eigen::Vector3f>;

/// Repeatable random numbers.
class Dice {
 public:
  explicit Dice(unsigned seed) : engine_(seed) {}
  double uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(engine_()) / 4294967296.0);
  }
  Eigen::Vector3d vector(double size) {
    const double x = uniform(-size, size), y = uniform(-size, size);
    return {x, y, uniform(-size, size)};
  }
  Pose pose(double translation_m, double rotation_rad) {
    const Eigen::Vector3d t = vector(translation_m);
    return {so3_exp(vector(rotation_rad)), t};
  }

 private:
  std::mt19937 engine_;
};

/// Adds `n` points of the parallelogram corner + a u + b v, a and b in [0, 1).
inline void add_patch(Cloud& cloud, Dice& dice, int n, const Eigen::Vector3d& corner,
                      const Eigen::Vector3d& u, const Eigen::Vector3d& v) {
  for (int i = 0; i < n; ++i) {
    const double a = dice.uniform(0, 1), b = dice.uniform(0, 1);
    cloud.push_back((corner + a * u + b * v).cast<float>());
  }
}

/// Hall of 24 x 16 x 6 m about the origin with three boxes in it: observes all six directions.
inline Cloud room(unsigned seed, int per_wall = 6000) {
  using V = Eigen::Vector3d;
  Dice dice(seed);
  Cloud c;
  add_patch(c, dice, 2 * per_wall, {-12, -8, -2}, {24, 0, 0}, {0, 16, 0});
  add_patch(c, dice, 2 * per_wall, {-12, -8, 4}, {24, 0, 0}, {0, 16, 0});
  for (const double x : {-12.0, 12.0}) add_patch(c, dice, per_wall, {x, -8, -2}, {0, 16, 0}, {0, 0, 6});
  for (const double y : {-8.0, 8.0}) add_patch(c, dice, per_wall, {-12, y, -2}, {24, 0, 0}, {0, 0, 6});
  for (const V& at : {V(4, 3, -2), V(-7, -4, -2), V(6, -6, -2)}) {
    add_patch(c, dice, per_wall / 4, at, {2, 0, 0}, {0, 0, 3});
    add_patch(c, dice, per_wall / 4, at, {0, 2, 0}, {0, 0, 3});
    add_patch(c, dice, per_wall / 4, at + V(0, 0, 3), {2, 0, 0}, {0, 2, 0});
  }
  return c;
}

/// Two parallel walls and a floor along x, apart from each other so that no edge tells where along x one is.
inline Cloud corridor(unsigned seed, int per_wall = 6000) {
  Dice dice(seed);
  Cloud c;
  add_patch(c, dice, per_wall, {-25, -3, -2}, {50, 0, 0}, {0, 6, 0});
  for (const double y : {-6.0, 6.0}) add_patch(c, dice, per_wall, {-25, y, 1}, {50, 0, 0}, {0, 0, 6});
  return c;
}

/// `cloud` as seen from a sensor at `pose`.
inline Cloud seen_from(const Cloud& cloud, const Pose& pose) {
  const Pose inverse = pose.inverse();
  Cloud out;
  out.reserve(cloud.size());
  for (const auto& p : cloud) out.push_back((inverse * p.cast<double>()).cast<float>());
  return out;
}

/// A sweep of 0.1 s of these points, fired evenly in their order.
inline Scan scan_of(const Cloud& cloud, std::int64_t sequence) {
  Scan s;
  s.sequence = sequence;
  s.utime = 1000000 + 100000 * sequence;
  s.duration_us = 100000;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    s.x.push_back(cloud[i].x());
    s.y.push_back(cloud[i].y());
    s.z.push_back(cloud[i].z());
    s.time.push_back(static_cast<float>(i) / static_cast<float>(cloud.size()));
  }
  return s;
}

/// The message of the Error that `run` throws; "no error" if it throws none.
template <class Run>
std::string error_of(const Run& run) {
  try {
    run();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

/// Both poses' numbers are the same to the last bit.
inline bool same_bits(const Pose& a, const Pose& b) {
  return a.translation == b.translation && a.rotation.coeffs() == b.rotation.coeffs();
}

}  // namespace hp2::test
