// Columns of numbers inside a block of bytes: what binary point formats (PCD, PLY, PointCloud2, HeLiPR) have
// in common.
#pragma once
#include <cstddef>
#include <string>
#include <vector>

namespace hp2 {

enum class ScalarType {
  kInt8,
  kUint8,
  kInt16,
  kUint16,
  kInt32,
  kUint32,
  kInt64,
  kUint64,
  kFloat32,
  kFloat64
};

/// Bytes of one number.
std::size_t scalar_size(ScalarType type);

/// One number per point, `stride` bytes apart, no alignment assumed.
struct Column {
  const char* first = nullptr;  ///< Number of point 0.
  std::size_t stride = 0;       ///< Bytes from one point to the next.
  ScalarType type = ScalarType::kFloat32;
  bool big_endian = false;
};

/// Appends nothing, replaces all: `out` becomes the n numbers of `column`, converted. The caller ensures that
/// first + (n - 1) * stride + scalar_size(type) lies inside its block.
void read_column(const Column& column, std::size_t n, std::vector<float>& out);
void read_column(const Column& column, std::size_t n, std::vector<double>& out);

/// Whether a field of this name (any case) is a point's intensity.
bool is_intensity_name(const std::string& name);
/// Whether a field of this name (any case) is a point's time: t, t_ns, offset_time, time_stamp, scalar_Time
/// and every other name with "time" or "stamp" in it.
bool is_time_name(const std::string& name);

}  // namespace hp2
