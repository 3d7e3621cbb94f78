#include "common/transport/lcm_bus.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

#include <lcm/lcm-cpp.hpp>
#include <spdlog/spdlog.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr int kReceiveBufferBytes = 4 << 20;
// What the kernel charges for a received datagram of kPieceBytes: 64 kB of data and its bookkeeping when it
// comes in one piece over lo, 41 pages of 2304 bytes when it comes in fragments over Ethernet.
constexpr int kChargedPerPiece = 94'464;

std::string full_url(const std::string& wanted) {
  std::string url = wanted;
  if (url.empty()) {
    const char* environment = std::getenv("LCM_DEFAULT_URL");
    url = environment != nullptr && *environment != '\0' ? environment : "udpm://239.255.76.67:7667?ttl=0";
  }
  if (url.rfind("udpm://", 0) == 0 && url.find("recv_buf_size") == std::string::npos) {
    url += (url.find('?') == std::string::npos ? "?" : "&") + std::string("recv_buf_size=") +
           std::to_string(kReceiveBufferBytes);
  }
  return url;
}

// LCM does not tell its socket, but the kernel grants any socket of this process the same buffer.
int granted_receive_buffer(const std::string& url) {
  int wanted = kReceiveBufferBytes;
  const auto at = url.find("recv_buf_size=");
  if (at != std::string::npos) wanted = std::atoi(url.c_str() + at + std::strlen("recv_buf_size="));
  const int fd = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return 212'992;
  ::setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &wanted, sizeof wanted);
  int granted = 0;
  socklen_t size = sizeof granted;
  ::getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &granted, &size);
  ::close(fd);
  return granted;
}

// LCM takes about ten, and does not say which of its calls failed for want of one.
void check_descriptors() {
  constexpr int kNeeded = 16;
  std::array<int, kNeeded> opened{};
  int n = 0;
  while (n < kNeeded &&
         (opened[static_cast<std::size_t>(n)] = ::open("/dev/null", O_RDONLY | O_CLOEXEC)) >= 0)
    ++n;
  const int reason = errno;
  for (int i = 0; i < n; ++i) ::close(opened[static_cast<std::size_t>(i)]);
  if (n == kNeeded) return;
  throw Error("too few files can be opened",
              std::string(std::strerror(reason)) + ", " + std::to_string(n) + " are left of " +
                  std::to_string(kNeeded) + " that are needed",
              "Allow more with ulimit -n, e.g. ulimit -n 1024.");
}

}  // namespace

struct LcmBus::Subscription {
  Callback callback;
  std::exception_ptr& error;
  // LCM is written in C: an exception must not pass through it.
  void handle(const lcm::ReceiveBuffer* buffer, const std::string& /*channel*/) {
    try {
      callback(static_cast<const std::uint8_t*>(buffer->data), buffer->data_size);
    } catch (...) {
      error = std::current_exception();
    }
  }
};

struct LcmBus::Lcm {
  explicit Lcm(const std::string& url) : lcm(url) {}
  lcm::LCM lcm;
  std::vector<std::unique_ptr<Subscription>> subscriptions;
};

LcmBus::LcmBus(const std::string& url) : url_(full_url(url)) {
  check_descriptors();
  lcm_ = std::make_unique<Lcm>(url_);
  if (!lcm_->lcm.good()) {
    throw Error("LCM cannot be started", url_,
                "Check the URL (udpm://ADDRESS:PORT?ttl=0); if there is no route for multicast, run as root: "
                "ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo");
  }
  receive_capacity_ = std::max(2, granted_receive_buffer(url_) / kChargedPerPiece);
  wake_fd_ = ::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (wake_fd_ < 0)
    throw Error("no event descriptor", std::strerror(errno), "Close other programs and try again.");
}

LcmBus::~LcmBus() {
  if (wake_fd_ >= 0) ::close(wake_fd_);
}

void LcmBus::publish(const std::string& channel, const void* data, std::size_t size) {
  if (lcm_->lcm.publish(channel, data, static_cast<unsigned int>(size)) != 0) {
    spdlog::debug("LCM could not send {} bytes on {}: {}", size, channel, std::strerror(errno));
  }
}

void LcmBus::subscribe(const std::string& channel, Callback callback, int queue_capacity) {
  auto subscription = std::make_unique<Subscription>(Subscription{std::move(callback), error_});
  auto* handle = lcm_->lcm.subscribeFunction(
      channel,
      +[](const lcm::ReceiveBuffer* buffer, const std::string& name, Subscription* s) {
        s->handle(buffer, name);
      },
      subscription.get());
  if (handle == nullptr) {
    throw Error(
        "LCM cannot receive", url_,
        "Multicast does not work on this machine. Run as root: ip link set lo multicast on; ip route add "
        "224.0.0.0/4 dev lo");
  }
  handle->setQueueCapacity(queue_capacity);
  // LCM opens its receiving socket at the first subscription.
  if (lcm_->subscriptions.empty() && url_.rfind("udpm://", 0) == 0 && !filter_.attach(url_)) {
    spdlog::warn("LCM's receiving socket was not found: malformed datagrams are not kept away from it");
  }
  lcm_->subscriptions.push_back(std::move(subscription));
  wanted_.channels.push_back(channel);
  if (passes_over_ && !filter_.attach(url_, wanted_)) {
    passes_over_ = false;
    filter_.attach(url_);  // the one that is there would keep the new channel away
  }
}

void LcmBus::set_address(const std::string& channel, std::uint64_t type, std::size_t offset,
                         std::int64_t address) {
  wanted_.addressed = {channel, type, offset, address};
}

std::int64_t LcmBus::dropped() const { return filter_.dropped(); }

std::int64_t LcmBus::now_us() const {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t LcmBus::wall_us() const {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

void LcmBus::post(std::function<void()> job) {
  {
    const std::lock_guard<std::mutex> lock(jobs_mutex_);
    jobs_.push_back(std::move(job));
  }
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = ::write(wake_fd_, &one, sizeof one);
}

void LcmBus::run_jobs() {
  std::uint64_t count = 0;
  [[maybe_unused]] const auto got = ::read(wake_fd_, &count, sizeof count);
  std::vector<std::function<void()>> jobs;
  {
    const std::lock_guard<std::mutex> lock(jobs_mutex_);
    jobs.swap(jobs_);
  }
  for (auto& job : jobs) job();
}

void LcmBus::run(const std::function<bool()>& tick) {
  constexpr std::int64_t kTickUs = 5'000;
  // By now all is subscribed to.
  if (!lcm_->subscriptions.empty()) passes_over_ = filter_.attach(url_, wanted_);
  std::int64_t next_tick = now_us();
  while (true) {
    const std::int64_t now = now_us();
    if (now >= next_tick) {
      if (!tick()) return;
      next_tick = now + kTickUs;
    }
    pollfd fds[2] = {{lcm_->lcm.getFileno(), POLLIN, 0}, {wake_fd_, POLLIN, 0}};
    const int wait_ms = static_cast<int>(std::max<std::int64_t>(0, next_tick - now_us() + 999) / 1000);
    if (::poll(fds, 2, wait_ms) <= 0) continue;
    if ((fds[1].revents & POLLIN) != 0) run_jobs();
    if ((fds[0].revents & POLLIN) == 0) continue;
    lcm_->lcm.handle();
    if (error_) std::rethrow_exception(error_);
  }
}

}  // namespace hp2
