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
  /// Unfragmented messages on `unwanted_channel` are kept away, too: LCM's sockets hear every channel, and would be
  /// woken by each piece of a scan that is meant for another process, only to throw it away.
  /// @param unwanted_channel empty: none
  /// @return false if there is no such socket (another kind of URL, or nothing is subscribed to yet)
  bool attach(const std::string& url, const std::string& unwanted_channel = "");
  /// Datagrams that did not reach LCM: refused by the filter, unwanted, or lost because the receive buffer was full.
  std::int64_t dropped() const;

 private:
  int fd_ = -1;  // LCM's
};

}  // namespace hp2
