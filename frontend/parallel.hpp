// Deterministic parallel loops: the work is cut into blocks whose number depends on the work alone, never on
// the number of threads, so that sums taken block by block come out the same to the last bit.
#pragma once
#include <algorithm>
#include <cstddef>
#include <memory>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace hp2 {

/// The thread sanitizer does not see how TBB, whose library is not built with it, hands work to its threads
/// and back: it is told. What the blocks of one loop do to each other it still finds.
class HandOver {
 public:
#ifdef __SANITIZE_THREAD__
  void give() const { __tsan_release(const_cast<HandOver*>(this)); }
  void take() const { __tsan_acquire(const_cast<HandOver*>(this)); }

 private:
  char address_ = 0;
#else
  void give() const {}
  void take() const {}
#endif
};

/// Runs loops on a fixed number of threads.
class Parallel {
 public:
  /// @param threads at least 1; 1 runs everything on the calling thread
  explicit Parallel(int threads) : threads_(std::max(1, threads)) {
    if (threads_ > 1) arena_ = std::make_unique<tbb::task_arena>(threads_);
  }

  int threads() const { return threads_; }

  static std::size_t block_count(std::size_t n, std::size_t block_size) {
    return (n + block_size - 1) / block_size;
  }

  /// Calls body(block, begin, end) for the blocks [begin, end) of [0, n), block = begin / block_size.
  template <class Body>
  void for_blocks(std::size_t n, std::size_t block_size, const Body& body) const {
    const std::size_t blocks = block_count(n, block_size);
    const auto run = [&](std::size_t b) { body(b, b * block_size, std::min(n, (b + 1) * block_size)); };
    if (threads_ == 1 || blocks < 2) {
      for (std::size_t b = 0; b < blocks; ++b) run(b);
      return;
    }
    const HandOver to_threads, back;
    to_threads.give();
    arena_->execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, blocks, 1),
          [&](const tbb::blocked_range<std::size_t>& r) {
            to_threads.take();
            for (std::size_t b = r.begin(); b != r.end(); ++b) run(b);
            back.give();
          },
          tbb::simple_partitioner());
    });
    back.take();
  }

 private:
  int threads_;
  std::unique_ptr<tbb::task_arena> arena_;
};

}  // namespace hp2
