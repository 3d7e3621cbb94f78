#include "player/calibration/find_rings.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace hp2 {
namespace {

constexpr double kBin_deg = 0.02;
constexpr float kNear_m = 2.0F;        // nearer points show the offsets of the beams' origins
constexpr double kEmptyShare = 2e-5;   // of all points: bins with fewer are noise
constexpr double kInPeaks = 0.95;      // of all points, or there are no rings
constexpr double kLargestWidth = 0.5;  // of the gap to the next ring
constexpr std::size_t kFewest = 2, kMost = 512;

struct Peak {
  double first_deg = 0.0, last_deg = 0.0, sum = 0.0, n = 0.0;
  double angle() const { return sum / n; }
};

/// Runs of bins that hold points.
std::vector<Peak> find_peaks(const std::vector<double>& count, double total) {
  std::vector<Peak> peaks;
  bool in_peak = false;
  for (std::size_t b = 0; b < count.size(); ++b) {
    const bool full = count[b] > kEmptyShare * total;
    const double angle = (static_cast<double>(b) + 0.5) * kBin_deg - 90.0;
    if (full && !in_peak) peaks.push_back({angle, angle, 0.0, 0.0});
    in_peak = full;
    if (!full) continue;
    peaks.back().last_deg = angle;
    peaks.back().sum += angle * count[b];
    peaks.back().n += count[b];
  }
  return peaks;
}

bool narrow(const std::vector<Peak>& peaks) {
  for (std::size_t k = 0; k < peaks.size(); ++k) {
    double gap = 180.0;
    if (k > 0) gap = std::min(gap, peaks[k].angle() - peaks[k - 1].angle());
    if (k + 1 < peaks.size()) gap = std::min(gap, peaks[k + 1].angle() - peaks[k].angle());
    if (peaks[k].last_deg - peaks[k].first_deg > kLargestWidth * gap) return false;
  }
  return true;
}

}  // namespace

std::vector<double> find_rings(const std::vector<Scan>& scans) {
  std::vector<double> count(static_cast<std::size_t>(180.0 / kBin_deg) + 1, 0.0);
  double total = 0.0;
  for (const Scan& scan : scans) {
    for (std::size_t i = 0; i < scan.size(); ++i) {
      const float horizontal = std::hypot(scan.x[i], scan.y[i]);
      if (!(std::hypot(horizontal, scan.z[i]) > kNear_m) || !std::isfinite(horizontal + scan.z[i])) continue;
      const double angle_deg = std::atan2(scan.z[i], horizontal) * 180.0 / M_PI;
      count[static_cast<std::size_t>((angle_deg + 90.0) / kBin_deg)] += 1.0;
      total += 1.0;
    }
  }
  const std::vector<Peak> peaks = find_peaks(count, total);
  double inside = 0.0;
  for (const Peak& peak : peaks) inside += peak.n;
  if (peaks.size() < kFewest || peaks.size() > kMost || inside < kInPeaks * total || !narrow(peaks))
    return {};
  std::vector<double> angles;
  for (const Peak& peak : peaks) angles.push_back(peak.angle());
  return angles;
}

}  // namespace hp2
