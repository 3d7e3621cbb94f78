#include "common/transport/layout.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kI8 = 1, kI32 = 4, kF32 = 4, kI64 = 8, kF64 = 8, kBool = 1;
constexpr std::size_t kPose = 7 * kF64;
constexpr std::size_t kSubmapScan = 2 * kI64 + kPose + 36 * kF64 + kI8 + 3 * kF32 + kI32 + 6 * kF32;

}  // namespace

void LayoutWalker::skip(std::size_t bytes) {
  if (!ok_ || bytes > left_) {
    ok_ = false;
    return;
  }
  data_ += bytes;
  left_ -= bytes;
}

std::size_t LayoutWalker::count() {
  if (!ok_ || left_ < kI32) {
    ok_ = false;
    return 0;
  }
  const auto n = static_cast<std::int32_t>(std::uint32_t{data_[0]} << 24U | std::uint32_t{data_[1]} << 16U |
                                           std::uint32_t{data_[2]} << 8U | std::uint32_t{data_[3]});
  skip(kI32);
  if (n < 0) ok_ = false;
  return ok_ ? static_cast<std::size_t>(n) : 0;
}

std::size_t LayoutWalker::count(std::size_t bytes_each) {
  const std::size_t n = count();
  if (ok_ && n > left_ / bytes_each) ok_ = false;
  return ok_ ? n : 0;
}

void LayoutWalker::string() {
  const std::size_t n = count(1);
  if (!ok_ || n == 0 || data_[n - 1] != 0) {
    ok_ = false;
    return;
  }
  skip(n);
}

void walk(LayoutWalker& w, const chunk_t*) {
  w.skip(3 * kI64 + 5 * kI32);
  w.skip(w.count(1));
}

void walk(LayoutWalker& w, const closure_t*) {
  w.skip(4 * kI64 + kPose + 36 * kF64 + kI32 + 2 * kF64 + kBool);
  w.string();
}

void walk(LayoutWalker& w, const control_t*) {
  w.skip(kI64);
  w.string();
  w.skip(kI8 + kI64);
}

void walk(LayoutWalker& w, const correction_t*) { w.skip(3 * kI64 + kPose); }

void walk(LayoutWalker& w, const fetch_t*) {
  w.skip(3 * kI64);
  w.string();
  w.skip(3 * kI64);
  w.skip(w.count(kI32) * kI32);
}

void walk(LayoutWalker& w, const graph_t*) {
  w.skip(2 * kI64 + kBool + kPose);
  w.skip(w.count(kPose) * kPose);
  constexpr std::size_t kEdge = kPose + 36 * kF64;
  w.skip(w.count(kEdge) * kEdge);
  constexpr std::size_t kSmallestClosure = 4 * kI64 + kPose + 36 * kF64 + kI32 + 2 * kF64 + kBool + kI32 + 1;
  const std::size_t closures = w.count(kSmallestClosure);
  for (std::size_t i = 0; i < closures && w.ok(); ++i) walk(w, static_cast<const closure_t*>(nullptr));
}

void walk(LayoutWalker& w, const odometry_t*) {
  w.skip(5 * kI64 + kPose + kI64 + kPose + 36 * kF64 + kF64 + 2 * kI32 + kF64 + kI32 + kF64 + kI8 + 2 * kI32 +
         kI64 + 6 * kF64);
}

void walk(LayoutWalker& w, const offer_t*) {
  w.skip(3 * kI64);
  w.string();
  w.skip(2 * kI64 + kBool + kI8);
}

void walk(LayoutWalker& w, const resume_t*) {
  w.skip(3 * kI64 + kBool + kPose);
  w.skip(w.count(1));
}

void walk_before_points(LayoutWalker& w) {
  w.skip(2 * kI64);
  w.string();
  w.skip(2 * kI64);
}

void walk(LayoutWalker& w, const scan_t*) {
  walk_before_points(w);
  w.skip(w.count(3 * kF32) * 3 * kF32);
  w.skip(w.count(kF32) * kF32);
  w.skip(w.count(kF32) * kF32);
}

void walk(LayoutWalker& w, const status_t*) {
  w.skip(4 * kI64);
  w.string();
  w.string();
  w.skip(kI32);
  w.string();
  w.skip(kI8);
  w.string();
  w.skip(2 * kI64 + 2 * kF64);
  constexpr std::size_t kSmallestCounter = kI32 + 1 + kI64;
  const std::size_t counters = w.count(kSmallestCounter);
  for (std::size_t i = 0; i < counters && w.ok(); ++i) {
    w.string();
    w.skip(kI64);
  }
}

void walk(LayoutWalker& w, const submap_t*) {
  w.skip(2 * kI64 + kPose + kF64 + kBool);
  constexpr std::size_t kPoint = 3 * kF32 + 3 * kI8 + kI32;
  w.skip(w.count(kPoint) * kPoint);
  w.skip(w.count(kSubmapScan) * kSubmapScan);
  w.skip(kI64);
  w.skip(w.count(1));
}

void walk(LayoutWalker& w, const trajectory_t*) {
  w.skip(2 * kI64);
  constexpr std::size_t kEntry = 2 * kI64 + kI32 + 2 * kPose;
  w.skip(w.count(kEntry) * kEntry);
}

}  // namespace hp2
