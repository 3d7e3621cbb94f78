// The robust scale sigma: RMS of the recent motion prediction errors (paper, eq. 9 and 10).
#pragma once
#include <deque>

#include "common/byte_io.hpp"
#include "common/geometry/pose.hpp"

namespace hp2 {

/// Sliding window of motion errors.
class AdaptiveScale {
 public:
  /// @param initial_m  sigma until the sensor has moved [m]
  /// @param minimum_m  sigma never falls below this [m]
  /// @param window     number of errors that count, N
  AdaptiveScale(double initial_m, double minimum_m, int window);

  /// @param stretch how much farther off this prediction may be than one over a usual interval
  double sigma_m(double stretch = 1.0) const;
  /// err = |dt| + 2 r_max sin(theta / 2) of the difference between the registered pose and the predicted one
  /// [m].
  /// @param max_range_m r_max, the farthest observed point: turns a rotation error into a displacement there
  static double error_m(const Pose& predicted_from_registered, double max_range_m);
  /// Adds an error [m] of a prediction that may have been farther off by `stretch`.
  void add(double error_m, double stretch = 1.0);

  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  double initial_, minimum_;
  std::size_t window_;
  std::deque<double> errors_;
};

}  // namespace hp2
