#include "player/readers/bags/message_reader.hpp"

#include "common/error.hpp"

namespace hp2 {

MessageReader::MessageReader(std::string_view message, Encoding encoding, std::string where)
    : message_(message), cdr_(encoding == Encoding::kCdr), where_(std::move(where)) {
  if (!cdr_) return;
  const std::string_view head = take_bytes(4);
  const auto kind = static_cast<unsigned char>(head[1]);
  // 0 and 1: plain CDR; 6 and 7: plain CDR of version 2, which aligns to 4 bytes at most. Odd is
  // little-endian.
  if (head[0] != 0 || (kind != 0 && kind != 1 && kind != 6 && kind != 7))
    throw Error("a message is not in plain CDR", where_, "Record the topic again with ros2 bag record.");
  big_endian_ = kind % 2 == 0;
  most_aligned_ = kind >= 6 ? 4 : 8;
  message_.remove_prefix(4);  // gaps count from here
  at_ = 0;
}

std::string_view MessageReader::take_bytes(std::size_t n) {
  if (n > left()) throw Error("a message is truncated", where_, "The recording is damaged: copy it again.");
  const std::string_view taken = message_.substr(at_, n);
  at_ += n;
  return taken;
}

void MessageReader::align(std::size_t size) {
  if (!cdr_) return;
  size = std::min(size, most_aligned_);
  at_ = std::min((at_ + size - 1) / size * size, message_.size());
}

std::string_view MessageReader::take_string() {
  std::string_view text = take_bytes(take<std::uint32_t>());
  if (cdr_ && !text.empty() && text.back() == '\0') text.remove_suffix(1);
  return text;
}

std::uint32_t MessageReader::take_count(std::size_t least) {
  const auto count = take<std::uint32_t>();
  if (count > left() / std::max<std::size_t>(least, 1))
    throw Error("a message promises " + std::to_string(count) + " entries of at least " +
                    std::to_string(least) + " bytes, but has " + std::to_string(left()) + " bytes",
                where_, "The driver or the recording is damaged.");
  return count;
}

MessageHeader MessageReader::take_header() {
  MessageHeader header;
  if (!cdr_) take<std::uint32_t>();  // sequence
  const auto seconds = take<std::uint32_t>();
  const auto nanoseconds = take<std::uint32_t>();
  header.stamp_us = static_cast<std::int64_t>(seconds) * 1'000'000 + nanoseconds / 1000;
  header.frame = std::string(take_string());
  return header;
}

}  // namespace hp2
