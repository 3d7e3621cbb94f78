// Drops datagrams that no LCM program sends. LCM's receiver trusts their headers: a fragment whose offset
// lies before the beginning of its message would be written there.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace hp2 {

/// The messages that a process receives. LCM's sockets receive every channel: each message for another
/// process would wake two threads, only to be dropped.
struct WantedMessages {
  /// A channel on which each message names who it is for.
  struct Addressed {
    std::string channel;
    std::uint64_t type = 0;    ///< First 8 bytes of such a message, big-endian; others are for everybody.
    std::size_t offset = 0;    ///< Of the address in the message.
    std::int64_t address = 0;  ///< This process's.
  };
  std::vector<std::string> channels;  ///< Empty: all.
  Addressed addressed;                ///< Empty channel: none is.
};

/// The filter on one receiving socket. The kernel applies it, before the receive buffer is charged.
class DatagramFilter {
 public:
  /// Finds the socket of this process that receives for `url` (udpm://GROUP:PORT?...) and puts the filter on
  /// it. Lets through: LC02 and LC03 with a channel name of at most 63 characters that ends inside the
  /// datagram, messages of at most 256 MB, fragments that begin inside their message.
  /// Of unfragmented messages only `wanted` ones.
  /// @return false if there is no such socket (another kind of URL, or nothing is subscribed to yet)
  bool attach(const std::string& url, const WantedMessages& wanted = {});
  /// Datagrams that did not reach LCM: refused by the filter, unwanted, or lost because the receive buffer
  /// was full.
  std::int64_t dropped() const;

 private:
  int fd_ = -1;  // LCM's
};

}  // namespace hp2
