// The progress line: scans done, scans per second, times real time, time left.
#pragma once
#include <cstdint>
#include <string>

namespace hp2 {

/// Rewrites one line on a terminal; elsewhere prints a plain line every 5 seconds.
class Progress {
 public:
  /// @param period_s recorded time between two scans [s]
  Progress(std::int64_t total, double period_s);
  /// @param rate scans a second
  void show(std::int64_t done, double rate, const std::string& remark, std::int64_t now_us);
  /// The final line.
  void close(std::int64_t done, std::int64_t now_us);

 private:
  std::int64_t total_;
  double period_s_;
  bool terminal_;
  std::int64_t last_us_ = 0, first_us_ = 0, first_done_ = 0, last_done_ = -1;
};

}  // namespace hp2
