// A network in memory that loses, doubles and reorders, with a clock turned by hand.
#pragma once
#include <deque>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "common/transport/bus.hpp"

namespace hp2 {

class FakeNetwork;

/// One process's connection to a FakeNetwork.
class FakeBus : public Bus {
 public:
  explicit FakeBus(FakeNetwork& network);
  ~FakeBus() override;
  void publish(const std::string& channel, const void* data, std::size_t size) override;
  void subscribe(const std::string& channel, Callback callback, int queue_capacity) override;
  std::int64_t now_us() const override;
  std::int64_t wall_us() const override { return now_us(); }
  int receive_capacity() const override;
  std::int64_t dropped() const override { return 0; }
  void set_address(const std::string& /*channel*/, std::uint64_t /*type*/, std::size_t /*offset*/,
                   std::int64_t /*address*/) override {}
  bool passes_over() const override { return false; }

 private:
  friend class FakeNetwork;
  FakeNetwork& network_;
  std::multimap<std::string, Callback> subscriptions_;
  std::deque<std::pair<std::string, std::vector<std::uint8_t>>> buffer_;
};

/// Connects FakeBus objects. A receiver's buffer holds 3 large datagrams, as the default receive buffer does,
/// or more.
class FakeNetwork {
 public:
  explicit FakeNetwork(int capacity = 3) : capacity_(capacity) {}
  double loss = 0.0, duplication = 0.0, reordering = 0.0;
  std::int64_t now = 1'000'000;
  std::int64_t overflowed = 0;  ///< Large datagrams that found a receiver's buffer full.
  std::map<std::string, std::int64_t> bytes_published;  ///< A channel.
  std::function<void(const std::string&, std::vector<std::uint8_t>&)> tamper;

  /// Lets every process handle what is in its buffer, then turns the clock.
  void step(std::int64_t us) {
    for (int round = 0; round < 50; ++round) {
      bool any = false;
      for (auto* bus : buses_) {
        std::deque<std::pair<std::string, std::vector<std::uint8_t>>> messages;
        messages.swap(bus->buffer_);
        if (chance(reordering) && messages.size() > 1) std::swap(messages.front(), messages.back());
        for (auto& [channel, bytes] : messages) {
          any = true;
          const auto [first, last] = bus->subscriptions_.equal_range(channel);
          for (auto it = first; it != last; ++it) it->second(bytes.data(), bytes.size());
        }
      }
      if (!any) break;
    }
    now += us;
  }

 private:
  friend class FakeBus;
  bool chance(double p) { return p > 0 && std::uniform_real_distribution<>(0, 1)(rng_) < p; }
  void send(const std::string& channel, std::vector<std::uint8_t> bytes) {
    bytes_published[channel] += static_cast<std::int64_t>(bytes.size());
    if (tamper) tamper(channel, bytes);
    for (auto* bus : buses_) {
      if (chance(loss)) continue;
      const int copies = chance(duplication) ? 2 : 1;
      for (int i = 0; i < copies; ++i) {
        if (bytes.size() > 30'000 && bus->subscriptions_.count(channel) != 0) {
          int large = 0;
          for (const auto& m : bus->buffer_) large += m.second.size() > 30'000 ? 1 : 0;
          if (large >= capacity_) {
            ++overflowed;
            continue;
          }
        }
        bus->buffer_.emplace_back(channel, bytes);
      }
    }
  }
  const int capacity_;
  std::vector<FakeBus*> buses_;
  std::mt19937 rng_{7};
};

inline FakeBus::FakeBus(FakeNetwork& network) : network_(network) { network_.buses_.push_back(this); }
inline FakeBus::~FakeBus() {
  auto& all = network_.buses_;
  for (auto it = all.begin(); it != all.end(); ++it) {
    if (*it == this) {
      all.erase(it);
      break;
    }
  }
}
inline void FakeBus::publish(const std::string& channel, const void* data, std::size_t size) {
  const auto* p = static_cast<const std::uint8_t*>(data);
  network_.send(channel, std::vector<std::uint8_t>(p, p + size));
}
inline void FakeBus::subscribe(const std::string& channel, Callback callback, int /*queue_capacity*/) {
  subscriptions_.emplace(channel, std::move(callback));
}
inline int FakeBus::receive_capacity() const { return network_.capacity_; }
inline std::int64_t FakeBus::now_us() const { return network_.now; }

}  // namespace hp2
