// Stretches of a drive, thinned out, for the trials of this folder.
#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "player/readers/drive.hpp"
#include "player/sweep/sweep_trial.hpp"

namespace hp2 {

/// Scans that are tried at once.
constexpr std::size_t kStretch = 25;

/// Reads the drive's scans `begin`, `begin` + 1, ..., `n` of them at most: fewer at the drive's end, or if
/// one cannot be read or holds next to nothing.
std::vector<Scan> read_stretch(const Drive& drive, std::size_t begin, std::size_t n);

/// Thins them out. @param stamps of all scans of the drive [us]
std::vector<TrialScan> thin_stretch(const std::vector<Scan>& scans, const std::vector<std::int64_t>& stamps,
                                    std::size_t begin, double scale);

}  // namespace hp2
