// What every conversion from a message checks, and how it lays out matrices.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>

#include "common/submap.hpp"

namespace hp2 {

/// Times [us] far beyond any clock's epoch, yet far from overflow when they are added up.
inline bool sane_time(std::int64_t utime) {
  constexpr std::int64_t kMost = std::int64_t{1} << 60;
  return utime > -kMost && utime < kMost;
}

/// No value is infinite or not a number.
template <class Array>
bool all_finite(const Array& values) {
  return std::all_of(std::begin(values), std::end(values), [](auto v) { return std::isfinite(v); });
}

/// Row-major, as messages have them.
inline Matrix6d to_matrix(const double (&m)[36]) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(m);
}
inline void from_matrix(const Matrix6d& matrix, double (&m)[36]) {
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>{m} = matrix;
}

}  // namespace hp2
