// Checks the scans of a live producer, field by field, with messages for its author.
#pragma once
#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "common/scan.hpp"

namespace hp2 {

/// Why decode_scan() refuses these bytes: the field, its value and the valid range.
std::string scan_fault(const std::uint8_t* data, std::size_t size);

/// Remarks on scans that can be decoded, each kind once.
class ScanChecks {
 public:
  /// Looks at one scan that came at `now_us` (monotonic): the unit of its stamps, of its duration and of the
  /// times of its points, points that are no numbers.
  std::vector<std::string> look_at(const Scan& scan, std::int64_t now_us);
  /// The remark on a fault, the first time that it is met.
  std::vector<std::string> refused(const std::string& fault);

 private:
  std::set<std::string> told_;
  std::int64_t first_us_ = 0, first_utime_ = 0, first_sequence_ = -1;
  int scans_ = 0;
};

}  // namespace hp2
