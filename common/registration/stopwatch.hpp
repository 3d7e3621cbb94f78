// Times of stages.
#pragma once
#include <chrono>

namespace hp2 {

/// Runs from its construction.
class Stopwatch {
 public:
  /// Milliseconds since the last call (or construction).
  float lap_ms() {
    const auto now = std::chrono::steady_clock::now();
    const float ms = std::chrono::duration<float, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace hp2
