#include "player/process/progress.hpp"

#include <cmath>
#include <cstdio>
#include <unistd.h>

#include <fmt/format.h>

namespace hp2 {
namespace {

constexpr std::int64_t kTerminalPeriodUs = 200'000;
constexpr std::int64_t kPlainPeriodUs = 5'000'000;

std::string duration(double seconds) {
  const auto s = static_cast<long>(std::lround(seconds));
  return s >= 3600 ? fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
                   : fmt::format("{}:{:02}", s / 60, s % 60);
}

}  // namespace

Progress::Progress(std::int64_t total, double period_s)
    : total_(total), period_s_(period_s), terminal_(::isatty(STDOUT_FILENO) != 0) {}

void Progress::show(std::int64_t done, double rate, const std::string& remark, std::int64_t now_us) {
  if (first_us_ == 0 && done > 0) {
    first_us_ = now_us;
    first_done_ = done;
  }
  if (now_us - last_us_ < (terminal_ ? kTerminalPeriodUs : kPlainPeriodUs)) return;
  if (!terminal_ && done == last_done_ && done == 0) return;
  last_us_ = now_us;
  last_done_ = done;
  const double percent = total_ > 0 ? 100.0 * static_cast<double>(done) / static_cast<double>(total_) : 100.0;
  const std::string left = rate > 0 ? duration(static_cast<double>(total_ - done) / rate) : "-:--";
  const std::string line =
      fmt::format("{} of {} scans ({:.0f} %), {:.1f} scans/s, {:.1f} x real time, {} left{}", done, total_,
                  percent, rate, rate * period_s_, left, remark.empty() ? "" : ", " + remark);
  std::printf(terminal_ ? "\r\033[K%s" : "%s\n", line.c_str());
  std::fflush(stdout);
}

void Progress::close(std::int64_t done, std::int64_t now_us) {
  const double seconds = first_us_ > 0 ? static_cast<double>(now_us - first_us_) * 1e-6 : 0.0;
  const double rate = seconds > 0 ? static_cast<double>(done - first_done_) / seconds : 0.0;
  std::printf("%s%s\n", terminal_ ? "\r\033[K" : "",
              fmt::format("{} of {} scans in {}, {:.1f} scans/s, {:.1f} x real time", done, total_,
                          duration(seconds), rate, rate * period_s_)
                  .c_str());
  std::fflush(stdout);
}

}  // namespace hp2
