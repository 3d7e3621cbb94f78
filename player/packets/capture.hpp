// Captures of network packets (pcap, pcapng): the UDP datagrams in them, joined from their IP fragments.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

namespace hp2 {

/// One UDP datagram.
struct Datagram {
  std::uint64_t key = 0;         ///< Where its first fragment begins in the file.
  std::int64_t received_us = 0;  ///< When its last fragment was captured.
  std::string source;            ///< Sender's address and receiver's port: "192.168.1.201:2368".
  std::string_view payload;
};

/// A capture that is open. Thread-safe.
class Capture {
 public:
  /// @throws Error if it cannot be opened or is no capture
  explicit Capture(const std::string& path);
  ~Capture();

  /// Calls `use` for the datagrams with keys from `first` to `last`, in the order in which they were
  /// complete, until it returns false. Damage ends the reading; see damage().
  void read(std::uint64_t first, std::uint64_t last, const std::function<bool(const Datagram&)>& use) const;

  /// Where and why reading ended before the file's end, for people; "" if it did not.
  std::string damage() const;
  /// Packets that the capture holds a part of only (its snap length was too small), or whose fragments are
  /// missing.
  std::uint64_t cut_off() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace hp2
