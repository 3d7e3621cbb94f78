// Keeps datagrams that no LCM program sends away from LCM, whose receiver trusts the headers in them: a
// fragment that claims to lie before the beginning of its message is written there.
#pragma once
#include <cstdint>
#include <string>

namespace hp2 {

/// The filter on one receiving socket. The kernel applies it, before the receive buffer is charged.
class DatagramFilter {
 public:
  /// Finds the socket of this process that receives for `url` (udpm://GROUP:PORT?...) and puts the filter on
  /// it. Lets through: LC02 and LC03 with a channel name of at most 63 characters that ends inside the
  /// datagram, messages of at most 256 MB, fragments that begin inside their message.
  /// @return false if there is no such socket (another kind of URL, or nothing is subscribed to yet)
  bool attach(const std::string& url);
  /// Datagrams that did not reach LCM: refused by the filter, or lost because the receive buffer was full.
  std::int64_t dropped() const;

 private:
  int fd_ = -1;  // LCM's
};

}  // namespace hp2
