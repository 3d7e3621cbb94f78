#include "player/sweep/stretch.hpp"

#include <algorithm>

#include "common/error.hpp"
#include "common/registration/parallel.hpp"

namespace hp2 {

std::vector<Scan> read_stretch(const Drive& drive, std::size_t begin, std::size_t count) {
  const std::size_t n = std::min(count, drive.scans.size() - std::min(begin, drive.scans.size()));
  std::vector<Scan> scans(n);
  std::vector<std::uint8_t> good(n, 0);
  Parallel(2).for_blocks(n, 1, [&](std::size_t i, std::size_t, std::size_t) {
    try {
      drive.decode(drive.scans[begin + i], scans[i]);
      good[i] = scans[i].size() >= 100 ? 1 : 0;
    } catch (const Error&) {
      // It is reported when it is its turn to be played.
    }
  });
  scans.resize(static_cast<std::size_t>(std::find(good.begin(), good.end(), 0) - good.begin()));
  return scans;
}

std::vector<TrialScan> thin_stretch(const std::vector<Scan>& scans, const std::vector<std::int64_t>& stamps,
                                    std::size_t begin, double scale) {
  std::vector<TrialScan> thinned(scans.size());
  Parallel(2).for_blocks(scans.size(), 1, [&](std::size_t i, std::size_t, std::size_t) {
    thinned[i] = make_trial_scan(scans[i], scale);
    thinned[i].utime_s = 1e-6 * static_cast<double>(stamps[begin + i] - stamps[begin]);
  });
  return thinned;
}

}  // namespace hp2
