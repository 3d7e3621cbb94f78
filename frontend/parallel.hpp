// Deterministic parallel loops: the work is cut into blocks whose number depends on the work alone, never on
// the number of threads, so that sums taken block by block come out the same to the last bit.
#pragma once
#include <algorithm>
#include <cstddef>
#include <memory>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace hp2 {

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
    arena_->execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, blocks, 1),
          [&](const tbb::blocked_range<std::size_t>& r) {
            for (std::size_t b = r.begin(); b != r.end(); ++b) run(b);
          },
          tbb::simple_partitioner());
    });
  }

 private:
  int threads_;
  std::unique_ptr<tbb::task_arena> arena_;
};

}  // namespace hp2
