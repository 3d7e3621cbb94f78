// Takes the fields of a ROS message off its bytes: ROS 1's serialisation, and CDR of both byte orders.
#pragma once
#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "player/readers/bags/bag_file.hpp"

namespace hp2 {

/// A std_msgs/Header.
struct MessageHeader {
  std::int64_t stamp_us = 0;  ///< 0: none.
  std::string frame;
};

/// Reads one message from front to back. Every take throws Error where the message ends too early.
class MessageReader {
 public:
  /// @param where for the error message
  /// @throws Error if the encapsulation header is none that is known
  MessageReader(std::string_view message, Encoding encoding, std::string where);

  /// A number, behind the gap that CDR leaves before it.
  template <typename T>
  T take() {
    align(sizeof(T));
    char raw[sizeof(T)];
    std::memcpy(raw, take_bytes(sizeof(T)).data(), sizeof(T));
    if (big_endian_) std::reverse(raw, raw + sizeof(T));
    T value;
    std::memcpy(&value, raw, sizeof(T));
    return value;
  }
  std::string_view take_bytes(std::size_t n);
  std::string_view take_string();
  MessageHeader take_header();
  /// Number of entries of a sequence that follows, of at least `least` bytes each.
  std::uint32_t take_count(std::size_t least);
  /// Goes to the next multiple of `size`, where CDR does.
  void align(std::size_t size);

  bool big_endian() const { return big_endian_; }
  bool is_cdr() const { return cdr_; }
  std::size_t left() const { return message_.size() - at_; }
  const std::string& where() const { return where_; }

 private:
  std::string_view message_;  ///< Behind the encapsulation header.
  std::size_t at_ = 0;
  std::size_t most_aligned_ = 8;
  bool cdr_ = false;
  bool big_endian_ = false;
  std::string where_;
};

}  // namespace hp2
