// Writes any drive with ground truth in the layout of a public data set, as the data set's own files lie on
// disk: what the tests of readers and of scripts/reproduce.sh run on.
#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "player/scan_source.hpp"

namespace hp2::test {

/// Formats that write_dataset() knows: kitti, mulran, helipr-ouster, helipr-avia, helipr-aeva,
/// helipr-aeva-old (files of before the Aeva told intensity), helipr-velodyne, apollo.
const std::vector<std::string>& dataset_formats();

/// Writes the drive into `folder`, which is made; what lies there already (another sensor of a HeLiPR drive)
/// stays. KITTI's `folder` is .../sequences/NN; its poses go to .../poses/NN.txt.
///
/// Points keep their own instant where the format has times (MulRan: that of the column, so at most 64 points
/// in 1/1024 of a sweep). KITTI and Apollo are motion-compensated: there, points are moved to the middle of
/// the sweep by the ground truth. KITTI's points are written with the vertical angle error of the
/// benchmark's.
/// @throws Error for a drive without ground truth, or one that does not fit the format
void write_dataset(const ScanSource& drive, const std::string& format, const std::string& folder);

/// The instant of a drive [us] that the data sets with absolute times are made to begin at, added to the
/// drive's own times.
std::int64_t dataset_epoch_us(const std::string& format);

/// `scan` with its points as seen from the sensor in the middle of the sweep, without times.
Scan motion_compensated(const Scan& scan, const std::vector<StampedPose>& truth);

}  // namespace hp2::test
