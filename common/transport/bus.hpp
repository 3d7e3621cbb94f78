// What the protocol needs of a network: publish, subscribe, a clock. LcmBus is the real one; tests bring one
// that loses, doubles and reorders, with a clock that they turn by hand.
#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

namespace hp2 {

/// A publish/subscribe bus of byte messages. Everything on it happens in one thread.
class Bus {
 public:
  using Callback = std::function<void(const std::uint8_t* data, std::size_t size)>;

  virtual ~Bus() = default;
  /// Sends one message to every subscriber of `channel`, this process included. May be lost on the way.
  virtual void publish(const std::string& channel, const void* data, std::size_t size) = 0;
  /// Calls `callback` for every message on `channel`. At most `queue_capacity` messages wait; more are
  /// dropped.
  virtual void subscribe(const std::string& channel, Callback callback, int queue_capacity) = 0;
  /// Monotonic clock [us].
  virtual std::int64_t now_us() const = 0;
  /// Wall clock [us since 1970].
  virtual std::int64_t wall_us() const = 0;
  /// Datagrams of kPieceBytes that this process's receive buffer holds at once.
  virtual int receive_capacity() const = 0;
  /// Each message on `channel` that begins with `type` names at `offset` who it is for: those with another
  /// `address` need not reach this process.
  virtual void set_address(const std::string& channel, std::uint64_t type, std::size_t offset,
                           std::int64_t address) = 0;
  /// Datagrams that came to this process and were malformed, or found no room in its receive buffer; also
  /// messages for others, where passes_over().
  virtual std::int64_t dropped() const = 0;
  /// Whether messages on channels that this process does not subscribe to, and those addressed to others, are
  /// thrown away before it sees them.
  virtual bool passes_over() const = 0;
};

/// Bytes of a message's piece: as much as LCM sends in one datagram (65499 bytes), with room for the headers.
inline constexpr std::size_t kPieceBytes = 60000;

}  // namespace hp2
