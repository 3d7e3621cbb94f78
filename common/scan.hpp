// One LiDAR sweep as a sensor delivers it, before any correction.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace hp2 {

/// A sweep of n points as separate arrays. Coordinates [m] in the sensor's frame at each point's own firing
/// instant (not deskewed). `intensity` and `time` hold n entries or none.
struct Scan {
  std::int64_t sequence = 0;  ///< Number of the scan in its stream, from 0, rising by 1.
  std::int64_t utime = 0;     ///< Start of the sweep [us].
  std::int64_t duration_us =
      0;               ///< Length of the sweep [us]; 0: not known, or the points are deskewed already.
  std::string sensor;  ///< Name of the sensor or data set; for people.
  std::vector<float> x, y, z;    ///< [m]
  std::vector<float> intensity;  ///< Sensor's own scale; empty: absent.
  std::vector<float> time;       ///< Time in the sweep, 0 = start, 1 = end; empty: absent.

  std::size_t size() const { return x.size(); }
  /// Instant that a registered pose of this scan refers to: the end of the sweep [us].
  std::int64_t utime_end() const { return utime + duration_us; }
};

}  // namespace hp2
