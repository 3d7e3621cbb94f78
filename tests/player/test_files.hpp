// Writers of small files in the data sets' layouts.
#pragma once
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "common/error.hpp"
#include "common/scan.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2::test {

/// Little-endian bytes of a value, appended.
template <typename T>
void put(std::string& bytes, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  bytes.append(raw, sizeof(T));
}

/// n points with coordinates that tell them apart, exact in float.
inline Scan make_points(std::size_t n, int seed = 0) {
  Scan scan;
  for (std::size_t i = 0; i < n; ++i) {
    const auto k = static_cast<float>(i);
    scan.x.push_back(1.0F + k * 0.25F + static_cast<float>(seed));
    scan.y.push_back(-3.0F + k * 0.5F);
    scan.z.push_back(0.125F * k - 1.0F);
    scan.intensity.push_back(static_cast<float>(i % 7) * 0.125F);
  }
  return scan;
}

/// A scan as float32 x y z intensity.
inline std::string bin_of(const Scan& scan) {
  std::string bytes;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    put(bytes, scan.x[i]);
    put(bytes, scan.y[i]);
    put(bytes, scan.z[i]);
    put(bytes, scan.intensity[i]);
  }
  return bytes;
}

/// A pose line: no rotation, position (x, y, z).
inline std::string pose_line(double x, double y = 0, double z = 0) {
  return "1 0 0 " + std::to_string(x) + " 0 1 0 " + std::to_string(y) + " 0 0 1 " + std::to_string(z) + "\n";
}

/// Name of file number i: 000012.
inline std::string number(std::size_t i) {
  const std::string digits = std::to_string(i);
  return std::string(6 - digits.size(), '0') + digits;
}

inline void expect_same_points(const Scan& a, const Scan& b) {
  EXPECT_EQ(a.x, b.x);
  EXPECT_EQ(a.y, b.y);
  EXPECT_EQ(a.z, b.z);
  EXPECT_EQ(a.intensity, b.intensity);
}

/// The message of the Error that `f` throws; "" if it throws none.
template <typename F>
std::string error_of(const F& f) {
  try {
    f();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace hp2::test
