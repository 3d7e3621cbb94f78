#include "player/readers/column.hpp"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace hp2 {
namespace {

template <typename In, bool kSwap, typename Out>
void convert(const Column& column, std::size_t n, Out* out) {
  const char* p = column.first;
  if (std::is_same_v<In, Out> && !kSwap && column.stride == sizeof(In) && n > 0) {
    std::memcpy(out, p, n * sizeof(In));
    return;
  }
  for (std::size_t i = 0; i < n; ++i, p += column.stride) {
    char bytes[sizeof(In)];
    std::memcpy(bytes, p, sizeof(In));
    if (kSwap) std::reverse(bytes, bytes + sizeof(In));
    In value;
    std::memcpy(&value, bytes, sizeof(In));
    out[i] = static_cast<Out>(value);
  }
}

template <typename In, typename Out>
void convert_either(const Column& column, std::size_t n, Out* out) {
  if (column.big_endian)
    convert<In, true>(column, n, out);
  else
    convert<In, false>(column, n, out);
}

template <typename Out>
void read_any(const Column& column, std::size_t n, std::vector<Out>& out) {
  out.resize(n);
  switch (column.type) {
    case ScalarType::kInt8:
      return convert_either<std::int8_t>(column, n, out.data());
    case ScalarType::kUint8:
      return convert_either<std::uint8_t>(column, n, out.data());
    case ScalarType::kInt16:
      return convert_either<std::int16_t>(column, n, out.data());
    case ScalarType::kUint16:
      return convert_either<std::uint16_t>(column, n, out.data());
    case ScalarType::kInt32:
      return convert_either<std::int32_t>(column, n, out.data());
    case ScalarType::kUint32:
      return convert_either<std::uint32_t>(column, n, out.data());
    case ScalarType::kInt64:
      return convert_either<std::int64_t>(column, n, out.data());
    case ScalarType::kUint64:
      return convert_either<std::uint64_t>(column, n, out.data());
    case ScalarType::kFloat32:
      return convert_either<float>(column, n, out.data());
    case ScalarType::kFloat64:
      return convert_either<double>(column, n, out.data());
  }
}

bool is_one_of(std::string name, std::initializer_list<const char*> known) {
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::any_of(known.begin(), known.end(), [&](const char* k) { return name == k; });
}

}  // namespace

std::size_t scalar_size(ScalarType type) {
  switch (type) {
    case ScalarType::kInt8:
    case ScalarType::kUint8:
      return 1;
    case ScalarType::kInt16:
    case ScalarType::kUint16:
      return 2;
    case ScalarType::kInt32:
    case ScalarType::kUint32:
    case ScalarType::kFloat32:
      return 4;
    case ScalarType::kInt64:
    case ScalarType::kUint64:
    case ScalarType::kFloat64:
      return 8;
  }
  return 0;
}

void read_column(const Column& column, std::size_t n, std::vector<float>& out) { read_any(column, n, out); }
void read_column(const Column& column, std::size_t n, std::vector<double>& out) { read_any(column, n, out); }

bool is_intensity_name(const std::string& name) {
  return is_one_of(name, {"intensity", "i", "reflectivity", "reflectance", "scalar_intensity",
                          "scalar_reflectivity", "scalar_reflectance"});
}
bool is_time_name(const std::string& name) {
  std::string lower = name;
  for (char& c : lower) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  // offset_time, time_stamp, timestamps, stamps, gps_time, GpsTime, scalar_Time, t_ns, ...
  return is_one_of(lower, {"t", "ts", "t_s", "t_ms", "t_us", "t_ns", "scalar_t"}) ||
         lower.find("time") != std::string::npos || lower.find("stamp") != std::string::npos;
}

}  // namespace hp2
