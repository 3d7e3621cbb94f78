// The bus over LCM's UDP multicast, with the event loop of a process: one thread that handles messages,
// timers and the jobs that worker threads post to it.
#pragma once
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/transport/bus.hpp"
#include "common/transport/datagram_filter.hpp"

namespace hp2 {

/// LCM behind the Bus interface. All members but post() belong to the thread that calls run().
class LcmBus : public Bus {
 public:
  /// @param url LCM URL; empty: environment variable LCM_DEFAULT_URL, else udpm://239.255.76.67:7667?ttl=0. A
  /// receive
  ///            buffer of 4 MB is asked for (the kernel grants what net.core.rmem_max allows) unless the URL
  ///            says.
  /// @throws Error if the URL is not understood or multicast does not work on this machine
  explicit LcmBus(const std::string& url);
  ~LcmBus() override;
  LcmBus(const LcmBus&) = delete;
  LcmBus& operator=(const LcmBus&) = delete;

  void publish(const std::string& channel, const void* data, std::size_t size) override;
  void subscribe(const std::string& channel, Callback callback, int queue_capacity) override;
  std::int64_t now_us() const override;
  std::int64_t wall_us() const override;
  int receive_capacity() const override { return receive_capacity_; }
  void set_address(const std::string& channel, std::uint64_t type, std::size_t offset,
                   std::int64_t address) override;
  std::int64_t dropped() const override;
  bool passes_over() const override { return passes_over_; }

  /// The URL in use.
  const std::string& url() const { return url_; }

  /// Runs `job` in the loop's thread, soon. Thread-safe.
  void post(std::function<void()> job);
  /// Handles messages and posted jobs and calls `tick` every 5 ms, until `tick` returns false. Throws what
  /// they throw.
  void run(const std::function<bool()>& tick);

 private:
  struct Subscription;
  struct Lcm;
  void run_jobs();

  std::string url_;
  int receive_capacity_ = 2;
  DatagramFilter filter_;
  WantedMessages wanted_;
  bool passes_over_ = false;  // what is not wanted
  std::exception_ptr error_;  // thrown by a subscriber
  std::unique_ptr<Lcm> lcm_;
  int wake_fd_ = -1;
  std::mutex jobs_mutex_;
  std::vector<std::function<void()>> jobs_;
};

}  // namespace hp2
