// Sizes of the local map's voxels and of the downsampling: they follow from how densely
// and how far the sensor sees.
#pragma once
#include "common/byte_io.hpp"
#include "common/scan.hpp"

namespace hp2 {

/// Sizes that go together [m].
struct MapSizes {
  double voxel_m = 0.8;         ///< Edge of a local map voxel.
  double spacing_m = 0.3;       ///< Least distance between points of one voxel.
  double map_point_m = 0.3;     ///< One point per voxel of this edge of each scan goes to the map.
  double source_voxel_m = 0.7;  ///< Of these one per voxel of this edge is registered.
};

/// Settings of the rule.
struct MapScaleConfig {
  double smallest_m = 0.4, largest_m = 0.8;  ///< Bounds of the map's voxel [m].
  double lines = 2.65, surface = 3.1;        ///< Growths that they belong to; between them linear.
  double range_share = 0.04, least_m = 0.2;  ///< At most this share of the mean range, but not below [m].
  int every = 32;                            ///< Scans from one measurement to the next.
  double memory = 0.8;                       ///< Share of the mean growth that stays at a measurement.
  double hysteresis = 1.1;  ///< The voxel changes when the wanted one differs by this factor.
};

/// A voxel should be as small as the scene allows, and hold several scan lines. Where halving the voxels
/// gives nearly four times as many, the scan covers surfaces densely at that size; where it gives twice as
/// many or fewer, they fall apart into lines and points. The first scan sets the voxel; later it changes in
/// rare steps.
class MapScale {
 public:
  explicit MapScale(const MapScaleConfig& config = {}) : config_(config) {}

  /// Measures a scan if it is its turn; settles for the mean range of what was registered last [m].
  void add(const Scan& scan, double min_range_m, double max_range_m, double mean_range_m);
  /// Takes a measured growth (surface_growth()); not positive: the scan gives none.
  void add_growth(double growth);
  /// Sets the voxel by the growth so far and the mean range [m].
  void settle(double mean_range_m);
  /// Edge of the map's voxel now [m].
  double voxel_m() const { return voxel_m_ > 0.0 ? voxel_m_ : config_.largest_m; }

  void save(ByteWriter& out) const;
  void load(ByteReader& in);

 private:
  MapScaleConfig config_;
  int scans_ = 0;         // since the last measurement
  double growth_ = 0.0;   // running mean; 0: none yet
  double voxel_m_ = 0.0;  // 0: not set yet
};

/// Voxels of edge `voxel_m` that a scan's points occupy, over those of twice the edge: 1 to 4, and some more
/// where little is seen; 0 without points within the ranges [m].
double surface_growth(const Scan& scan, double voxel_m, double min_range_m, double max_range_m);

}  // namespace hp2
