#include "common/registration/parallel.hpp"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace hp2 {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kAwake = std::chrono::microseconds(30);  // a worker without work, before it sleeps
constexpr int kPausesALook = 64;                        // between two looks at the clock
constexpr std::uint64_t kLeft = 0xFFFFFFFFU;            // bits of Impl::state that count blocks

thread_local bool inside_a_block = false;

inline void pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace

// A thread begins with its own share of the blocks, which is the same in every loop: what it wrote in one
// loop is in its cache in the next. Then it helps the others.
struct WorkerPool::Impl {
  struct Job {
    std::size_t blocks = 0;
    void (*call)(const void*, std::size_t) = nullptr;
    const void* context = nullptr;
  };
  // Number of the job (upper half) and how many blocks of a thread's share nobody has taken yet. Taking one
  // is the permission to read `job`: it stays as it is until that block is done.
  struct alignas(64) Share {
    std::atomic<std::uint64_t> state{0};
  };

  explicit Impl(std::size_t workers) : shares(workers + 1) {}

  std::vector<Share> shares;                     // the caller's, then the workers'
  alignas(64) std::atomic<std::size_t> done{0};  // blocks of the job
  Job job;
  alignas(64) std::atomic<int> sleepers{0};
  std::atomic<bool> stop{false};
  std::mutex mutex;  // of `wake` and `error`
  std::condition_variable wake;
  std::exception_ptr error;
  std::vector<std::thread> threads;

  std::size_t share_end(std::size_t share) const { return job.blocks * (share + 1) / shares.size(); }

  bool take_block(std::size_t share) {
    std::atomic<std::uint64_t>& state = shares[share].state;
    std::uint64_t s = state.load(std::memory_order_relaxed);
    std::size_t left = 0;
    do {
      left = s & kLeft;
      if (left == 0) return false;
    } while (!state.compare_exchange_weak(s, s - 1, std::memory_order_acquire, std::memory_order_relaxed));
    try {
      job.call(job.context, share_end(share) - left);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (!error) error = std::current_exception();
    }
    done.fetch_add(1, std::memory_order_release);
    return true;
  }

  void take_blocks(std::size_t first_share) {
    for (std::size_t k = 0; k < shares.size(); ++k) {
      while (take_block((first_share + k) % shares.size())) {
      }
    }
  }

  void publish(const Job& next) {
    job = next;
    done.store(0, std::memory_order_relaxed);
    const std::uint64_t number = (shares[0].state.load(std::memory_order_relaxed) >> 32U) + 1;
    for (std::size_t s = 0; s < shares.size(); ++s) {
      const std::size_t begin = s == 0 ? 0 : share_end(s - 1);
      shares[s].state.store(number << 32U | (share_end(s) - begin));
    }
  }

  bool idle() const {
    if (stop.load()) return false;
    for (const Share& share : shares) {
      if ((share.state.load() & kLeft) != 0) return false;
    }
    return true;
  }

  void work(std::size_t own_share) {
    inside_a_block = true;  // all that this thread ever does
    while (!stop.load(std::memory_order_relaxed)) {
      take_blocks(own_share);
      const auto since = Clock::now();
      while (idle() && Clock::now() - since < kAwake) {
        for (int i = 0; i < kPausesALook && idle(); ++i) pause();
        if (idle()) std::this_thread::yield();  // threads with work go first
      }
      if (!idle()) continue;
      std::unique_lock<std::mutex> lock(mutex);
      ++sleepers;  // before the last look: run() looks for sleepers after it has shown its job
      wake.wait(lock, [this] { return !idle(); });
      --sleepers;
    }
  }
};

WorkerPool::WorkerPool(int workers) : impl_(std::make_unique<Impl>(static_cast<std::size_t>(workers))) {
  for (std::size_t i = 1; i < impl_->shares.size(); ++i)
    impl_->threads.emplace_back([this, i] { impl_->work(i); });
}

WorkerPool::~WorkerPool() {
  {
    const std::lock_guard<std::mutex> lock(impl_->mutex);
    impl_->stop = true;
  }
  impl_->wake.notify_all();
  for (auto& thread : impl_->threads) thread.join();
}

void WorkerPool::run(std::size_t blocks, void (*call)(const void*, std::size_t), const void* context) {
  if (inside_a_block) {
    for (std::size_t b = 0; b < blocks; ++b) call(context, b);
    return;
  }
  Impl& pool = *impl_;
  pool.publish({blocks, call, context});
  if (pool.sleepers.load() > 0) {
    // A thread that is about to sleep sleeps once the lock is free, and is then woken.
    { const std::lock_guard<std::mutex> lock(pool.mutex); }
    pool.wake.notify_all();
  }
  inside_a_block = true;
  pool.take_blocks(0);
  inside_a_block = false;
  for (int i = 0; pool.done.load(std::memory_order_acquire) != blocks; ++i) {
    pause();
    if (i % 512 == 511) std::this_thread::yield();  // the other thread may have no processor
  }
  if (pool.error) std::rethrow_exception(std::exchange(pool.error, nullptr));
}

}  // namespace hp2
