// ReadAhead gives what the source gives, in any order, with its errors, and reads ahead but not further than
// told.
#include "player/read_ahead.hpp"

#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <thread>

#include <gtest/gtest.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

/// 50 scans of no points; number 13 cannot be read.
class CountingSource : public ScanSource {
 public:
  const SourceInfo& info() const override { return info_; }
  std::size_t size() const override { return 50; }
  const std::vector<StampedPose>& ground_truth() const override { return poses_; }
  using ScanSource::read;
  Scan read(std::size_t index, Scan /*used_up*/) const override {
    if (index >= size()) throw Error("no such scan", std::to_string(index), "Ask for less.");
    const std::lock_guard<std::mutex> lock(mutex_);
    reads_.insert(index);
    if (index == 13) throw Error("the scan is damaged", "13", "Copy it again.");
    Scan scan;
    scan.sequence = static_cast<std::int64_t>(index);
    return scan;
  }
  std::multiset<std::size_t> reads() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return reads_;
  }

 private:
  SourceInfo info_;
  std::vector<StampedPose> poses_;
  mutable std::mutex mutex_;
  mutable std::multiset<std::size_t> reads_;
};

void wait_for_reads(const CountingSource& source, std::size_t n) {
  for (int i = 0; i < 2000 && source.reads().size() < n; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

TEST(ReadAhead, InOrderEachScanIsReadOnce) {
  const CountingSource source;
  {
    ReadAhead ahead(source, 3, 2);
    for (std::size_t i = 0; i < source.size(); ++i) {
      if (i == 13) {
        EXPECT_THROW(ahead.get(i), Error);
        EXPECT_THROW(ahead.get(i), Error);  // the same when asked again
      } else {
        EXPECT_EQ(ahead.get(i)->sequence, static_cast<std::int64_t>(i));
        EXPECT_EQ(ahead.get(i).get(), ahead.get(i).get());
      }
    }
    EXPECT_THROW(ahead.get(50), Error);
  }
  for (std::size_t i = 0; i < 50; ++i) EXPECT_EQ(source.reads().count(i), 1U) << i;
}

TEST(ReadAhead, ReadsAheadSoFarAndNoFurther) {
  const CountingSource source;
  ReadAhead ahead(source, 4, 1);
  ahead.get(20);
  wait_for_reads(source, 5);
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  const auto reads = source.reads();
  for (std::size_t i = 20; i <= 24; ++i) EXPECT_EQ(reads.count(i), 1U) << i;
  EXPECT_EQ(reads.count(25), 0U);
}

TEST(ReadAhead, SeeksBackAndForth) {
  const CountingSource source;
  ReadAhead ahead(source, 4, 2);
  for (const std::size_t i : {30U, 5U, 6U, 49U, 0U, 48U, 47U, 14U, 12U})
    EXPECT_EQ(ahead.get(i)->sequence, static_cast<std::int64_t>(i));
}

TEST(ReadAhead, SeveralThreadsMayAsk) {
  const CountingSource source;
  ReadAhead ahead(source, 2, 2);
  std::atomic<int> wrong{0};
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 4; ++t)
    threads.emplace_back([&, t] {
      for (std::size_t k = 0; k < 200; ++k) {
        const std::size_t i = (t * 17 + k * 7) % 50;
        if (i != 13 && ahead.get(i)->sequence != static_cast<std::int64_t>(i)) ++wrong;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(wrong, 0);
}

}  // namespace
}  // namespace hp2
