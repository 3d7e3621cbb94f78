// Loops on several threads: every block once, whatever the number of threads, nesting and exceptions.
#include "common/registration/parallel.hpp"

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

class ParallelThreads : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Threads, ParallelThreads, ::testing::Values(1, 2, 3, 8));

TEST_P(ParallelThreads, VisitsEveryElementOnceInManyShortLoops) {
  const Parallel parallel(GetParam());
  std::vector<int> visits(1000, 0);
  constexpr int kLoops = 3000;
  for (int loop = 0; loop < kLoops; ++loop) {
    const std::size_t block_size = 1 + static_cast<std::size_t>(loop % 300);
    parallel.for_blocks(visits.size(), block_size,
                        [&](std::size_t block, std::size_t begin, std::size_t end) {
                          EXPECT_EQ(begin, block * block_size);
                          for (std::size_t i = begin; i < end; ++i) ++visits[i];
                        });
  }
  for (const int v : visits) EXPECT_EQ(v, kLoops);
}

TEST_P(ParallelThreads, WakesUpAfterALongPause) {
  const Parallel parallel(GetParam());
  for (int loop = 0; loop < 20; ++loop) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    std::atomic<int> sum{0};
    parallel.for_blocks(10, 1,
                        [&](std::size_t block, std::size_t, std::size_t) { sum += static_cast<int>(block); });
    EXPECT_EQ(sum, 45);
  }
}

TEST_P(ParallelThreads, LoopsWithinABlockRunToTheirEnd) {
  const Parallel parallel(GetParam());
  std::atomic<int> sum{0};
  parallel.for_blocks(6, 1, [&](std::size_t, std::size_t, std::size_t) {
    parallel.for_blocks(
        7, 2, [&](std::size_t, std::size_t begin, std::size_t end) { sum += static_cast<int>(end - begin); });
  });
  EXPECT_EQ(sum, 42);
}

TEST_P(ParallelThreads, AnExceptionReachesTheCallerAndTheNextLoopWorks) {
  const Parallel parallel(GetParam());
  const auto loop = [&](std::size_t bad) {
    std::atomic<int> done{0};
    parallel.for_blocks(50, 1, [&](std::size_t block, std::size_t, std::size_t) {
      if (block == bad) throw std::runtime_error("block");
      ++done;
    });
    return done.load();
  };
  EXPECT_THROW(loop(17), std::runtime_error);
  EXPECT_EQ(loop(50), 50);
}

TEST(Parallel, AsManyThreadsWorkAsAreAskedFor) {
  const Parallel parallel(2);
  std::atomic<int> there{0};
  // Each block waits for the other one.
  parallel.for_blocks(2, 1, [&](std::size_t, std::size_t, std::size_t) {
    ++there;
    while (there < 2) std::this_thread::yield();
  });
  EXPECT_EQ(there, 2);
}

}  // namespace
}  // namespace hp2
