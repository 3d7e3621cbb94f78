// Deterministic parallel loops. The number of blocks depends on the work alone, never on the number of
// threads, so sums taken block by block are the same to the last bit.
#pragma once
#include <algorithm>
#include <cstddef>
#include <memory>

namespace hp2 {

/// Threads that take blocks of a loop beside the calling one. The loops of a scan follow each other within
/// microseconds: threads spin between them, and sleep after 30 microseconds without work. A task library's
/// threads would sleep between two loops: about forty wake-ups per scan, a quarter of its time.
class WorkerPool {
 public:
  /// @param workers threads beside the calling one, at least 1
  explicit WorkerPool(int workers);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// Calls call(context, b) for all b in [0, blocks), at most 2^31 of them, and returns when all have
  /// returned. One caller at a time; a call from within a block runs on that block's thread alone.
  /// @throws the first exception of a block, after the others have ended
  void run(std::size_t blocks, void (*call)(const void* context, std::size_t block), const void* context);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Runs loops on a fixed number of threads.
class Parallel {
 public:
  /// @param threads at least 1; 1 runs everything on the calling thread
  explicit Parallel(int threads) : threads_(std::max(1, threads)) {
    if (threads_ > 1) pool_ = std::make_unique<WorkerPool>(threads_ - 1);
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
    using Run = decltype(run);
    pool_->run(
        blocks, [](const void* context, std::size_t b) { (*static_cast<const Run*>(context))(b); }, &run);
  }

 private:
  int threads_;
  std::unique_ptr<WorkerPool> pool_;
};

}  // namespace hp2
