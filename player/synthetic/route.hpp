// The sensor's trajectory through a synthetic world, as a smooth function of time.
#pragma once
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"
#include "player/synthetic/world.hpp"

namespace hp2 {

/// How a route is driven.
struct RouteOptions {
  bool closed = false;                ///< The waypoints are a ring.
  double repeat_m = 0.0;              ///< How much of a ring is driven a second time.
  double corner_m = 6.0;              ///< How far corners are rounded.
  double right_m = 0.0;               ///< Distance to the right of the waypoints.
  double weave_m = 0.0;               ///< Amplitude of a slow weaving, so that no two passes are the same.
  double max_speed = 8.0;             ///< [m/s]
  double lateral_acceleration = 2.5;  ///< Limit in bends [m/s^2].
  double acceleration = 1.5;          ///< Limit along the route, also when braking [m/s^2].
  double sensor_height_m = 1.8;       ///< Above the ground.
  double sway_rad = 0.005;            ///< Amplitude of roll and pitch.
};

/// A route over the ground of a world. Position and heading are continuous, as is the speed.
class Route {
 public:
  Route(const std::vector<Eigen::Vector2d>& way_points, const RouteOptions& options, const Ground& ground);

  /// How long it takes [s].
  double duration() const { return static_cast<double>(distance_at_.size() - 1) * kTimeStep; }
  /// Length [m].
  double length() const { return static_cast<double>(points_.size() - 1) * kPointStep; }
  /// World-from-sensor at `time` [s] since the start; beyond the end it stands still.
  Pose pose_at(double time) const;

 private:
  static constexpr double kTimeStep = 0.05;   // s
  static constexpr double kPointStep = 0.25;  // m

  double distance_travelled(double time) const;

  RouteOptions options_;
  Ground ground_;
  std::vector<Eigen::Vector2d> points_;  ///< kPointStep apart along the route.
  std::vector<double> distance_at_;      ///< Distance travelled [m] at each kTimeStep.
  std::vector<double> speed_at_;         ///< And the speed there [m/s].
};

}  // namespace hp2
