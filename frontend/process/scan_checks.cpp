#include "frontend/process/scan_checks.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "common/transport/bulk_codec.hpp"
#include "common/transport/convert_checks.hpp"

namespace hp2 {
namespace {

// Scans whose stamps are looked at together; stamps in seconds show after some seconds only.
constexpr int kFewScans = 10, kManyScans = 50;

// How many units of this kind a microsecond field is filled with by mistake.
struct Unit {
  const char* name;
  double us;  // of one
};
constexpr std::array<Unit, 3> kWrongUnits{{{"nanoseconds", 1e-3}, {"milliseconds", 1e3}, {"seconds", 1e6}}};

bool about(double value, double expected) { return value > 0.3 * expected && value < 3.0 * expected; }

// Reads the head of scan_t field by field; LCM's numbers are big-endian.
std::int64_t number_at(const std::uint8_t* at) {
  std::uint64_t v = 0;
  for (int i = 0; i < 8; ++i) v = v << 8U | at[i];
  return static_cast<std::int64_t>(v);
}

std::string unit_of_utime(std::int64_t utime) {
  const double magnitude = std::abs(static_cast<double>(utime));
  if (magnitude > 1e18 && magnitude < 4.2e18) return " It looks like nanoseconds since 1970: divide by 1000.";
  return "";
}

}  // namespace

std::string scan_fault(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kFingerprint = 8, kBeforeSensor = kFingerprint + 16;
  if (size < kFingerprint || number_at(data) != scan_t::getHash())
    return "not a scan_t of this version: its fingerprint is another type's. Build the producer with "
           "lcmtypes/scan_t.lcm";
  LayoutWalker walker(data + kFingerprint, size - kFingerprint);
  walk_before_points(walker);
  if (!walker.ok() || size < kBeforeSensor)
    return fmt::format("a scan_t that is cut off: {} bytes do not hold its fields", size);
  const std::int64_t utime = number_at(data + kFingerprint), duration = number_at(data + kFingerprint + 8);
  // sequence and session_id lie before the number of points
  const std::int64_t sequence = number_at(walker.position() - 16);
  const std::uint8_t* count = walker.position();
  const auto left = static_cast<std::size_t>(data + size - count);
  if (left < 4) return fmt::format("a scan_t that is cut off: {} bytes do not hold its fields", size);
  const auto n = static_cast<std::int32_t>(std::uint32_t{count[0]} << 24U | std::uint32_t{count[1]} << 16U |
                                           std::uint32_t{count[2]} << 8U | std::uint32_t{count[3]});
  if (!sane_time(utime))
    return fmt::format("scan {}: utime {} is no time in microseconds.{}", sequence, utime,
                       unit_of_utime(utime));
  if (duration < 0 || duration > kLongestSweepUs) {
    return fmt::format("scan {}: duration {} is no length of a sweep in microseconds (0 to {}).{}", sequence,
                       duration, kLongestSweepUs,
                       duration > kLongestSweepUs ? " It looks like nanoseconds: divide by 1000." : "");
  }
  if (sequence < -1 || !sane_time(sequence))
    return fmt::format("sequence {} is no number of a scan: count from 0 on, rising by 1, or set -1",
                       sequence);
  if (n < 0) return fmt::format("scan {}: n is {}", sequence, n);
  if (static_cast<std::size_t>(n) > kMaxScanPoints) {
    return fmt::format(
        "scan {} has {} points; at most {} are taken (kMaxScanPoints). Thin it out in the driver", sequence,
        n, kMaxScanPoints);
  }
  if (!has_layout<scan_t>(data, size)) {
    return fmt::format("scan {}: its {} bytes do not hold what n = {}, n_intensity and n_time say", sequence,
                       size, n);
  }
  return fmt::format("scan {}: n_intensity and n_time must each be n = {} or 0", sequence, n);
}

std::vector<std::string> ScanChecks::refused(const std::string& fault) {
  // The kind is the text without its numbers.
  std::string kind;
  std::copy_if(fault.begin(), fault.end(), std::back_inserter(kind),
               [](char c) { return (c < '0' || c > '9') && c != '-'; });
  if (told_.size() > 30 || !told_.insert(kind).second) return {};
  return {"live scans are refused and counted (rejected): " + fault};
}

std::vector<std::string> ScanChecks::look_at(const Scan& scan, std::int64_t now_us) {
  std::vector<std::string> out;
  const auto tell = [&](const std::string& kind, const std::string& text) {
    if (told_.insert(kind).second) out.push_back(text);
  };
  // Times in the sweep.
  if (!scan.time.empty()) {
    const auto [low, high] = std::minmax_element(scan.time.begin(), scan.time.end(), [](float a, float b) {
      return std::isfinite(a) && (!std::isfinite(b) || a < b);
    });
    float most = 0.0F;
    for (const float t : scan.time)
      if (std::isfinite(t)) most = std::max(most, std::abs(t));
    const auto span = static_cast<double>(most), sweep_s = 1e-6 * static_cast<double>(scan.duration_us);
    const std::string belongs = " of the points: it is 0 at utime and 1 at utime + duration. ";
    if (!std::isfinite(*high)) {
      tell("time nan", "live scans have values that are no numbers in time[]" + belongs);
    } else if (scan.duration_us > 0 && sweep_s < 0.6 && span > 0.5 * sweep_s && span < 1.3 * sweep_s) {
      tell("time s",
           fmt::format("live scans have times in seconds (up to {:.3f}) in time[]{}Divide by the duration.",
                       span, belongs));
    } else if (span > 1.5 || *low < -0.5F) {
      std::string unit;
      for (const auto& [name, us] :
           {std::pair{"milliseconds", 1e3}, {"microseconds", 1.0}, {"nanoseconds", 1e-3}})
        if (scan.duration_us > 0 && span * us > 0.5e6 * sweep_s && span * us < 1.3e6 * sweep_s)
          unit = fmt::format(" They look like {}: divide by the duration in {}.", name, name);
      tell("time range",
           fmt::format("live scans have times from {:g} to {:g} in time[]{}{}", *low, *high, belongs, unit));
    }
  }
  if (scan.duration_us > 0 && scan.duration_us < 1000) {
    tell("duration",
         fmt::format("live scans last {} us after their field duration, which is in microseconds. Is it in "
                     "milliseconds? Leave it 0 if it is not known.",
                     scan.duration_us));
  }
  // The unit of the stamps: how they advance while scans arrive.
  if (scans_ == 0 || scan.utime < first_utime_) {
    scans_ = 0;
    first_us_ = now_us;
    first_utime_ = scan.utime;
  }
  ++scans_;
  if ((scans_ == kFewScans || scans_ == kManyScans) && scan.utime > first_utime_) {
    const auto arrived = static_cast<double>(now_us - first_us_),
               stamped = static_cast<double>(scan.utime - first_utime_);
    for (const Unit& unit : kWrongUnits) {
      const bool arrives_so = about(stamped * unit.us, arrived);
      const bool lasts_so = scan.duration_us > 1000 &&
                            about(stamped * unit.us, static_cast<double>(scan.duration_us) * (scans_ - 1));
      if (!arrives_so || !(lasts_so || scan.duration_us <= 1000)) continue;
      tell("utime unit",
           fmt::format("utime of the live scans rises by {:.3g} a second: it is in {}, and microseconds "
                       "belong there. The motion prediction depends on it.",
                       stamped / arrived * 1e6, unit.name));
    }
  }
  if (scans_ == kManyScans && scan.utime == first_utime_) {
    tell("utime still",
         fmt::format("utime of the live scans does not rise (it is {}): set the start of each sweep in "
                     "microseconds. Without it the motion is predicted as if scans came evenly.",
                     scan.utime));
  }
  return out;
}

}  // namespace hp2
