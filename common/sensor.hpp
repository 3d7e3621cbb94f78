// What is wrong with a sensor's own angles and ranges, and how scans are corrected by it.
#pragma once
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/config.hpp"
#include "common/scan.hpp"

namespace hp2 {

/// Errors of a sensor. Keys of the YAML section "sensor"; the defaults
/// correct nothing. A ring is told by its vertical angle as the driver computes it, so that any stream of
/// scans can be corrected, with or without ring numbers.
struct SensorCalibration {
  double vertical_angle_bias_deg = 0.0;        ///< True minus given vertical angle, of all points.
  std::vector<double> ring_angles_deg;         ///< Given vertical angle of each ring; empty: no rings.
  std::vector<double> ring_angle_offsets_deg;  ///< One per ring, on top of the bias; empty: none.
  std::vector<double> ring_range_offsets_m;    ///< Measured minus true range, one per ring; empty: none.
};

/// The section "sensor" bound to `calibration`, which must outlive it.
ConfigSection sensor_section(SensorCalibration& calibration);

/// True if `calibration` corrects anything. Scans must then reach it as the sensor gave them: no other
/// correction of vertical angles may be applied before.
bool corrects_scans(const SensorCalibration& calibration);

/// Checks what ranges of single keys cannot say. @throws Error
void validate(const SensorCalibration& calibration);

/// Turns each point up by `angle_rad` about the horizontal axis through the sensor. Points straight above or
/// below have no such axis and stay, as do those that are not finite.
void raise_vertical_angles(Scan& scan, double angle_rad);

/// Finds the ring of a point by its vertical angle.
class RingTable {
 public:
  static constexpr std::int16_t kNone = -1;
  /// @param angles_deg vertical angle of each ring, in any order, all different
  explicit RingTable(const std::vector<double>& angles_deg);
  /// Number of the ring whose angle is nearest, if it is within a third of the gap to the next ring.
  /// @param sine of the point's vertical angle, -1..1
  std::int16_t ring(float sine) const {
    return cells_[static_cast<std::size_t>(std::lround((sine + 1.0F) * (0.5F * (kCells - 1))))];
  }

 private:
  static constexpr std::size_t kCells = 1U << 15U;  // 0.0035 degrees at the horizon
  std::vector<std::int16_t> cells_;
};

/// Corrects scans by a calibration.
class SensorCorrection {
 public:
  /// @throws Error as validate()
  explicit SensorCorrection(const SensorCalibration& calibration);
  bool corrects() const { return corrects_; }
  /// Corrects the points; raw scans only, before any motion compensation.
  /// @return share of the finite points that lie on a ring of the calibration, 0..1; 1 if it has no rings
  double apply(Scan& scan) const;

 private:
  struct Ring {
    float cosine = 1.0F, sine = 0.0F, range_offset_m = 0.0F;
  };
  bool corrects_, has_rings_;
  RingTable table_;
  std::vector<Ring> rings_;  // the first is that of points on no ring
};

}  // namespace hp2
