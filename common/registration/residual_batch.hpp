// Residuals of a block of points side by side, so that their sums are taken four at a time.
#pragma once
#include <array>
#include <cstddef>

#include "common/registration/normal_equations.hpp"
#include "common/registration/simd.hpp"

namespace hp2 {

/// Up to kMost terms of the sums in NormalEquations. In floats: coordinates are relative to a place near the
/// sensor, and a batch's sums are added in doubles.
template <std::size_t kColumns>
class ResidualBatch {
 public:
  static constexpr std::size_t kMost = 256;

  /// Adds a row of values.
  void add(const std::array<float, kColumns>& row) {
    for (std::size_t c = 0; c < kColumns; ++c) columns_[c][size_] = row[c];
    ++size_;
  }
  std::size_t size() const { return size_; }

 protected:
  using Column = std::array<float, kMost>;
  // Rows up to the next multiple of four are made zero: they add nothing.
  std::size_t padded() {
    std::size_t n = size_;
    for (; n % 4 != 0; ++n) {
      for (auto& column : columns_) column[n] = 0.0F;
    }
    return n;
  }
  static float dot(const Column& a, const Column& b, std::size_t n) {
    Float4 even = {}, odd = {};
    std::size_t i = 0;
    for (; i + 8 <= n; i += 8) {
      even += load4(&a[i]) * load4(&b[i]);
      odd += load4(&a[i + 4]) * load4(&b[i + 4]);
    }
    if (i < n) even += load4(&a[i]) * load4(&b[i]);
    return sum4(even + odd);
  }
  static float sum(const Column& a, std::size_t n) {
    Float4 total = {};
    for (std::size_t i = 0; i < n; i += 4) total += load4(&a[i]);
    return sum4(total);
  }
  static void multiply(const Column& a, const Column& b, std::size_t n, Column& out) {
    for (std::size_t i = 0; i < n; ++i) out[i] = a[i] * b[i];
  }

  alignas(16) std::array<Column, kColumns> columns_;
  std::size_t size_ = 0;
};

/// Rows p (3), n (3), e, w of point-to-plane residuals.
class PlaneBatch : public ResidualBatch<8> {
 public:
  /// Adds the rows to `sums` and empties the batch.
  void flush(PlaneSums& sums) {
    const std::size_t n = padded();
    const Column &px = columns_[0], &py = columns_[1], &pz = columns_[2];
    const Column &nx = columns_[3], &ny = columns_[4], &nz = columns_[5];
    const Column &e = columns_[6], &w = columns_[7];
    Column cx, cy, cz, wj;
    for (std::size_t i = 0; i < n; ++i) {
      cx[i] = py[i] * nz[i] - pz[i] * ny[i];
      cy[i] = pz[i] * nx[i] - px[i] * nz[i];
      cz[i] = px[i] * ny[i] - py[i] * nx[i];
    }
    const Column* j[6] = {&nx, &ny, &nz, &cx, &cy, &cz};
    int k = 0;
    for (int a = 0; a < 6; ++a) {
      multiply(w, *j[a], n, wj);
      for (int b = a; b < 6; ++b) sums.h[k++] += static_cast<double>(dot(wj, *j[b], n));
      sums.g[a] += static_cast<double>(dot(wj, e, n));
    }
    multiply(w, e, n, wj);
    sums.squares += static_cast<double>(dot(wj, e, n));
    sums.count += static_cast<int>(size_);
    size_ = 0;
  }
};

/// Rows p (3), r = p - q (3), w of point-to-point residuals.
class PointBatch : public ResidualBatch<7> {
 public:
  /// Adds the rows to `sums` and empties the batch.
  void flush(PointSums& sums) {
    const std::size_t n = padded();
    const Column &px = columns_[0], &py = columns_[1], &pz = columns_[2];
    const Column &rx = columns_[3], &ry = columns_[4], &rz = columns_[5], &w = columns_[6];
    Column wpx, wpy, wpz;
    multiply(w, px, n, wpx);
    multiply(w, py, n, wpy);
    multiply(w, pz, n, wpz);
    const auto d = [n](const Column& a, const Column& b) { return static_cast<double>(dot(a, b, n)); };
    sums.w += static_cast<double>(sum(w, n));
    sums.p += Eigen::Vector3f(sum(wpx, n), sum(wpy, n), sum(wpz, n)).cast<double>();
    sums.pp[0] += d(wpx, px);
    sums.pp[1] += d(wpx, py);
    sums.pp[2] += d(wpx, pz);
    sums.pp[3] += d(wpy, py);
    sums.pp[4] += d(wpy, pz);
    sums.pp[5] += d(wpz, pz);
    sums.pxr += Eigen::Vector3d(d(wpy, rz) - d(wpz, ry), d(wpz, rx) - d(wpx, rz), d(wpx, ry) - d(wpy, rx));
    sums.r += Eigen::Vector3d(d(w, rx), d(w, ry), d(w, rz));
    multiply(w, rx, n, wpx);
    multiply(w, ry, n, wpy);
    multiply(w, rz, n, wpz);
    sums.squares += d(wpx, rx) + d(wpy, ry) + d(wpz, rz);
    sums.count += static_cast<int>(size_);
    size_ = 0;
  }
};

}  // namespace hp2
