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
  /// Datagrams that came to this process and were malformed, or found no room in its receive buffer; also pieces of
  /// scans, where passes_scans_over().
  virtual std::int64_t dropped() const = 0;
  /// Whether pieces of scans are thrown away before this process sees them: it subscribes to none.
  virtual bool passes_scans_over() const = 0;
};

/// Bytes of a message's piece: as much as LCM sends in one datagram (65499 bytes), with room for the headers.
inline constexpr std::size_t kPieceBytes = 60000;

}  // namespace hp2
