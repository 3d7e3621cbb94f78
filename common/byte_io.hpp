// Saving plain values to bytes and reading them back, bounds checked. Little-endian machines only, as all we
// run on.
#pragma once
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include <Eigen/Core>

#include "common/error.hpp"
#include "common/geometry/pose.hpp"

namespace hp2 {

/// Appends values to a byte vector.
class ByteWriter {
 public:
  explicit ByteWriter(std::vector<std::uint8_t>& bytes) : bytes_(bytes) {}

  template <class T, class = std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>>>
  void put(T value) {
    const auto* p = reinterpret_cast<const std::uint8_t*>(&value);
    bytes_.insert(bytes_.end(), p, p + sizeof(T));
  }
  template <class T, int R, int C>
  void put(const Eigen::Matrix<T, R, C>& m) {
    static_assert(R > 0 && C > 0, "fixed sizes only");
    const auto* p = reinterpret_cast<const std::uint8_t*>(m.data());
    bytes_.insert(bytes_.end(), p, p + sizeof(T) * R * C);
  }
  void put(const std::uint8_t* bytes, std::size_t size) { bytes_.insert(bytes_.end(), bytes, bytes + size); }
  /// Reserves room for this many more bytes.
  void reserve(std::size_t size) { bytes_.reserve(bytes_.size() + size); }
  void put(const Pose& pose) {
    put(pose.translation);
    put(Eigen::Vector4d(pose.rotation.coeffs()));
  }

 private:
  std::vector<std::uint8_t>& bytes_;
};

/// Reads values from bytes that ByteWriter wrote.
class ByteReader {
 public:
  /// @param what what the bytes are, for the message of an error, e.g. "the front-end's saved state"
  ByteReader(const std::uint8_t* begin, const std::uint8_t* end, std::string what)
      : p_(begin), end_(end), what_(std::move(what)) {}

  std::size_t left() const { return static_cast<std::size_t>(end_ - p_); }

  /// @throws Error if the bytes end before the value does
  template <class T>
  T take() {
    T value{};
    read(value);
    return value;
  }
  /// The error to throw when a value that was read is invalid.
  [[noreturn]] void fail(const std::string& where) const {
    throw Error(what_ + " is damaged or of another version", where, "Start a new session.");
  }

 private:
  template <class T>
  std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>> read(T& value) {
    if (left() < sizeof(T)) fail("it ends too early");
    std::memcpy(&value, p_, sizeof(T));
    p_ += sizeof(T);
  }
  template <class T, int R, int C>
  void read(Eigen::Matrix<T, R, C>& m) {
    for (int i = 0; i < R * C; ++i) read(m.data()[i]);
  }
  void read(Pose& pose) {
    read(pose.translation);
    Eigen::Vector4d q;
    read(q);
    // What no pose can be would turn every later one into NaN; saved poses are unit up to rounding.
    const bool rigid = std::abs(q.norm() - 1.0) < 1e-6;
    if (!rigid || !(pose.translation.norm() < 1e8)) fail("a pose is not one");
    pose.rotation.coeffs() = q;  // as saved, to the last bit: not normalised again
  }

  const std::uint8_t* p_;
  const std::uint8_t* end_;
  std::string what_;
};

}  // namespace hp2
