// The estimate for people, and as a file for --config.
#pragma once
#include <string>
#include <vector>

#include "common/sensor.hpp"
#include "player/calibration/calibrate.hpp"

namespace hp2 {

/// A table of the estimate: one line per ring.
/// @param rings vertical angle of each ring [deg]; empty: rings cannot be told
std::string describe(const CalibrationEstimate& estimate, const std::vector<double>& rings);

/// The estimate as settings. Rings that the drive does not determine get the bias alone, ranges that it does
/// not determine stay.
SensorCalibration make_calibration(const CalibrationEstimate& estimate, const std::vector<double>& rings);

/// Writes the section "sensor" with the standard deviations as comments.
/// @param drive its name, for people
/// @throws Error if the file cannot be written
void write_calibration(const std::string& path, const CalibrationEstimate& estimate,
                       const std::vector<double>& rings, const std::string& drive);

}  // namespace hp2
