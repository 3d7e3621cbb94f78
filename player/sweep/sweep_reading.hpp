// How the points of a scan without times may lie in the sweep: the readings that are compared.
#pragma once
#include <string>
#include <vector>

#include "common/scan.hpp"

namespace hp2 {

/// One way to give the points of a scan their times in the sweep.
struct SweepReading {
  enum class Kind {
    kCompensated,  ///< All points hold for one instant: there is nothing to undo.
    kAzimuth,      ///< The sensor spins: the time follows from the point's azimuth.
    kGiven,        ///< As the file has it.
    kReversed,     ///< As the file has it, from the end to the start.
  };
  Kind kind = Kind::kCompensated;
  bool clockwise = true;  ///< kAzimuth: seen from above.
  double cut_rad = 0.0;   ///< kAzimuth: where a sweep begins; x forward, counted towards y.

  friend bool operator!=(const SweepReading& a, const SweepReading& b) {
    return a.kind != b.kind || a.clockwise != b.clockwise || a.cut_rad != b.cut_rad;
  }
};

/// Time in the sweep of a point at `azimuth_rad`, 0..1, for a reading by azimuth.
float time_of_azimuth(const SweepReading& reading, float azimuth_rad);

/// Sets scan.time as `reading` says: empty if the points are compensated, unchanged if they are as given.
void apply_reading(const SweepReading& reading, Scan& scan);

/// In words: "distorted, clockwise from 180 degrees".
std::string to_text(const SweepReading& reading);

/// What the order of the points tells of the sweep.
struct PointOrder {
  bool spins = false;      ///< The points go round in azimuth.
  bool one_turn = false;   ///< They go round once: the order of firing.
  bool clockwise = false;  ///< The way in which they go round.
  bool has_cut = false;    ///< All scans begin near the same azimuth.
  double cut_rad = 0.0;    ///< That azimuth.
};

/// Judges the order of the points of a few scans.
PointOrder order_of_points(const std::vector<const Scan*>& scans);

}  // namespace hp2
