#include "frontend/parallel.hpp"

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

constexpr auto kAwake = std::chrono::microseconds(100);  // a worker without work, before it sleeps
constexpr int kPausesALook = 64;                         // between two looks at the clock
constexpr std::uint64_t kLeft = 0xFFFFFFFFU;             // bits of Impl::state that count blocks

thread_local bool inside_a_block = false;

inline void pause() {
#if defined(__x86_64__) || defined(__i386__)
  __builtin_ia32_pause();
#elif defined(__aarch64__)
  asm volatile("yield");
#endif
}

}  // namespace

struct WorkerPool::Impl {
  struct Job {
    std::size_t blocks = 0;
    void (*call)(const void*, std::size_t) = nullptr;
    const void* context = nullptr;
  };

  // Number of the job (upper half) and its blocks that nobody has taken yet. Taking one is the permission to
  // read `job`: it stays as it is until that block is done.
  std::atomic<std::uint64_t> state{0};
  std::atomic<std::size_t> done{0};  // blocks of the job
  Job job;
  std::atomic<int> sleepers{0};
  std::atomic<bool> stop{false};
  std::mutex mutex;  // of `wake` and `error`
  std::condition_variable wake;
  std::exception_ptr error;
  std::vector<std::thread> threads;

  bool take_block() {
    std::uint64_t s = state.load(std::memory_order_relaxed);
    std::size_t left = 0;
    do {
      left = s & kLeft;
      if (left == 0) return false;
    } while (!state.compare_exchange_weak(s, s - 1, std::memory_order_acquire, std::memory_order_relaxed));
    try {
      job.call(job.context, job.blocks - left);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      if (!error) error = std::current_exception();
    }
    done.fetch_add(1, std::memory_order_release);
    return true;
  }

  bool idle() const { return (state.load() & kLeft) == 0 && !stop.load(); }

  void work() {
    inside_a_block = true;  // all that this thread ever does
    while (!stop.load(std::memory_order_relaxed)) {
      if (take_block()) continue;
      const auto since = Clock::now();
      while (idle() && Clock::now() - since < kAwake) {
        for (int i = 0; i < kPausesALook && idle(); ++i) pause();
      }
      if (!idle()) continue;
      std::unique_lock<std::mutex> lock(mutex);
      ++sleepers;  // before the last look: run() looks for sleepers after it has shown its job
      wake.wait(lock, [this] { return !idle(); });
      --sleepers;
    }
  }
};

WorkerPool::WorkerPool(int workers) : impl_(std::make_unique<Impl>()) {
  for (int i = 0; i < workers; ++i) impl_->threads.emplace_back([this] { impl_->work(); });
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
  pool.job = {blocks, call, context};
  pool.done.store(0, std::memory_order_relaxed);
  pool.state.store(((pool.state.load() >> 32U) + 1) << 32U | blocks);
  if (pool.sleepers.load() > 0) {
    { const std::lock_guard<std::mutex> lock(pool.mutex); }  // who was about to sleep sleeps now, and hears
    pool.wake.notify_all();
  }
  inside_a_block = true;
  while (pool.take_block()) {
  }
  inside_a_block = false;
  for (int i = 0; pool.done.load(std::memory_order_acquire) != blocks; ++i) {
    pause();
    if (i % 4096 == 4095) std::this_thread::yield();  // the other thread may have no processor
  }
  if (pool.error) std::rethrow_exception(std::exchange(pool.error, nullptr));
}

}  // namespace hp2
