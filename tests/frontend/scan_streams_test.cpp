#include "frontend/process/scan_streams.hpp"

#include <numeric>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace hp2 {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kStart = 1'700'000'000'000'000, kStep = 100'000;

// A scan whose points tell it from every other one.
Scan make(std::int64_t number, std::int64_t utime, float points, const std::string& sensor = "os1") {
  Scan scan;
  scan.sequence = number;
  scan.utime = utime;
  scan.duration_us = kStep;
  scan.sensor = sensor;
  scan.x = {points, 1.0F};
  scan.y = {2.0F, points};
  scan.z = {0.0F, 0.5F};
  return scan;
}

// Feeds scans at 10 Hz and keeps what came out.
struct Feed {
  ScanStreams streams;
  std::int64_t now = 1'000'000;
  std::vector<std::int64_t> numbers;
  std::vector<float> points;
  std::map<std::string, std::int64_t> counts;
  std::vector<std::string> remarks;
  std::int64_t fed = 0;

  void keep(std::vector<Scan> scans) {
    for (const Scan& s : scans) {
      numbers.push_back(s.sequence);
      points.push_back(s.x[0]);
    }
    for (const auto& [name, n] : streams.take_counts()) counts[name] += n;
    for (auto& r : streams.take_remarks()) remarks.push_back(std::move(r));
  }
  void give(const Scan& scan, std::int64_t sender = 0) {
    ++fed;
    keep(streams.take(scan, sender, now));
  }
  void wait(std::int64_t us) {
    for (const std::int64_t end = now + us; now < end; now += 5000) keep(streams.poll(now));
  }
  // Scan i of a stream, with this number, at its time.
  void at(int i, std::int64_t number, std::int64_t sender = 0) {
    give(make(number, kStart + i * kStep, static_cast<float>(i)), sender);
    wait(kStep);
  }
  std::int64_t left_out() const {
    std::int64_t sum = 0;
    for (const char* name :
         {"duplicates", "live_scans_other_sender", "live_scans_late", "live_scans_bad_number"})
      if (counts.count(name) != 0) sum += counts.at(name);
    return sum;
  }
  // Nothing disappears without a reason.
  void expect_all_accounted_for() {
    wait(3'000'000);
    EXPECT_EQ(static_cast<std::int64_t>(numbers.size()) + left_out(), fed);
    for (std::size_t i = 1; i < numbers.size(); ++i) EXPECT_GT(numbers[i], numbers[i - 1]);
  }
};

std::vector<std::int64_t> range(std::int64_t first, std::int64_t end) {
  std::vector<std::int64_t> v(static_cast<std::size_t>(end - first));
  std::iota(v.begin(), v.end(), first);
  return v;
}

/// A producer that is started again counts from this number on.
class Restart : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Numbers, Restart, ::testing::Values(0, 1, 5, 20, 49, 1000000));

TEST_P(Restart, LosesNoScanWhenStampsGoOn) {
  Feed feed;
  for (int i = 0; i < 50; ++i) feed.at(i, i);
  for (int i = 50; i < 80; ++i) feed.at(i, GetParam() + i - 50);
  feed.expect_all_accounted_for();
  EXPECT_EQ(feed.numbers, range(0, 80));
}

TEST_P(Restart, LosesNoScanAfterAPause) {
  for (const std::int64_t pause_us : {700'000, 5'000'000}) {
    Feed feed;
    for (int i = 0; i < 50; ++i) feed.at(i, i, 11);
    feed.wait(pause_us);
    for (int i = 50; i < 80; ++i)  // another process of the same driver
      feed.at(i + static_cast<int>(pause_us / kStep), GetParam() + i - 50, 12);
    feed.expect_all_accounted_for();
    EXPECT_EQ(feed.numbers, range(0, 80)) << pause_us;
  }
}

TEST_P(Restart, LosesNoScanWhenItsClockStartsAgainToo) {
  Feed feed;
  for (int i = 0; i < 50; ++i) feed.at(i, i);
  for (int i = 0; i < 30; ++i) {
    feed.give(make(GetParam() + i, 7'000 + i * kStep, 100.0F + static_cast<float>(i)));
    feed.wait(kStep);
  }
  feed.expect_all_accounted_for();
  EXPECT_EQ(feed.numbers, range(0, 80));
}

TEST(ScanStreams, MendsOneImpossibleNumber) {
  for (const std::int64_t odd :
       {std::int64_t{1'000'000'000}, std::int64_t{1} << 59, std::int64_t{0}, std::int64_t{7}}) {
    Feed feed;
    for (int i = 0; i < 60; ++i) feed.at(i, i == 30 ? odd : i);
    feed.expect_all_accounted_for();
    EXPECT_EQ(feed.numbers, range(0, 60)) << odd;
    ASSERT_EQ(feed.remarks.size(), 1U) << odd;
    EXPECT_THAT(feed.remarks[0], HasSubstr(std::to_string(odd)));
  }
}

TEST(ScanStreams, LosesAtMostTheScanWithAnImpossibleNumberWhereStampsTellNothing) {
  Feed feed;
  for (int i = 0; i < 60; ++i) {
    feed.give(make(i == 30 ? 1'000'000'000 : i, 0, static_cast<float>(i)));
    feed.wait(kStep);
  }
  feed.expect_all_accounted_for();
  EXPECT_GE(feed.numbers.size(), 59U);
  EXPECT_LE(feed.numbers.back(), 60);
}

TEST(ScanStreams, KeepsTheGapOfScansThatAreMissing) {
  Feed feed;
  for (int i = 0; i < 20; ++i) feed.at(i, i);
  for (int i = 35; i < 50; ++i) feed.at(i, i);
  EXPECT_EQ(feed.numbers[19], 19);
  EXPECT_EQ(feed.numbers[20], 35);
  EXPECT_TRUE(feed.remarks.empty());
}

TEST(ScanStreams, DropsDuplicatesByTheirContent) {
  for (const bool numbered : {true, false}) {
    Feed feed;
    for (int i = 0; i < 30; ++i) {
      for (int twice = 0; twice < 2; ++twice) {
        feed.give(make(numbered ? i : -1, kStart + i * kStep, static_cast<float>(i)));
        feed.wait(30'000);
      }
      feed.wait(40'000);
    }
    feed.expect_all_accounted_for();
    EXPECT_EQ(feed.numbers, range(0, 30));
    EXPECT_EQ(feed.counts["duplicates"], 30);
  }
}

TEST(ScanStreams, TakesScansWithoutNumbersAndStamps) {
  Feed feed;
  for (int i = 0; i < 30; ++i) {
    feed.give(make(-1, 0, static_cast<float>(i)));
    feed.wait(kStep);
  }
  EXPECT_EQ(feed.numbers, range(0, 30));
}

TEST(ScanStreams, TakesScansWhoseNumbersNeverRise) {
  Feed feed;
  for (int i = 0; i < 30; ++i) feed.at(i, 7);
  feed.expect_all_accounted_for();
  EXPECT_EQ(feed.numbers, range(0, 30));
  EXPECT_EQ(feed.remarks.size(), 1U);
}

TEST(ScanStreams, GoesOnWhenTheClockJumps) {
  for (const std::int64_t jump : {std::int64_t{-3'600'000'000}, std::int64_t{1'700'000'000'000'000}}) {
    Feed feed;
    for (int i = 0; i < 60; ++i) {
      feed.give(make(i, kStart + i * kStep + (i >= 30 ? jump : 0), static_cast<float>(i)));
      feed.wait(kStep);
    }
    EXPECT_EQ(feed.numbers, range(0, 60));
  }
}

TEST(ScanStreams, CountsAScanThatComesLate) {
  Feed feed;
  for (const int i : {0, 1, 2, 3, 4, 6, 5, 7, 8, 9}) feed.at(i, i);
  feed.expect_all_accounted_for();
  EXPECT_EQ(feed.counts["live_scans_late"], 1);
  EXPECT_EQ(feed.numbers.back(), 9);
}

struct TwoSensors {
  const char* name;
  std::string second;            // name of the second sensor; the first is os1
  std::int64_t senders[2];       // 0: whole scans
  std::int64_t shift_us, first;  // of the second one's stamps, and its first number
  bool numbered = true;
};
class ScanStreamsOfTwo : public ::testing::TestWithParam<TwoSensors> {};
INSTANTIATE_TEST_SUITE_P(
    Sensors, ScanStreamsOfTwo,
    ::testing::Values(TwoSensors{"SameInEverything", "os1", {0, 0}, 0, 0},
                      TwoSensors{"HalfASweepApart", "os1", {0, 0}, 50'000, 0},
                      TwoSensors{"OtherSenders", "os1", {5, 6}, 30'000, 0},
                      TwoSensors{"OtherNames", "front", {0, 0}, 50'000, 0},
                      TwoSensors{"OtherNumbers", "os1", {0, 0}, 20'000, 900},
                      TwoSensors{"NoNumbersHalfASweepApart", "os1", {0, 0}, 50'000, 0, false},
                      TwoSensors{"NoNumbersCloseTogether", "os1", {0, 0}, 15'000, 0, false},
                      TwoSensors{"NoNumbersNearlyASweepApart", "os1", {0, 0}, 80'000, 0, false}),
    [](const auto& i) { return i.param.name; });

TEST_P(ScanStreamsOfTwo, KeepsOneAndTellsOfTheOther) {
  Feed feed;
  const TwoSensors& two = GetParam();
  for (int i = 0; i < 60; ++i) {
    feed.give(make(two.numbered ? i : -1, kStart + i * kStep, static_cast<float>(i)), two.senders[0]);
    feed.wait(45'000);
    feed.give(make(two.numbered ? two.first + i : -1, kStart + i * kStep + two.shift_us,
                   1000.0F + static_cast<float>(i), two.second),
              two.senders[1]);
    feed.wait(55'000);
  }
  feed.expect_all_accounted_for();
  int switches = 0, of_first = 0;
  for (std::size_t i = 0; i < feed.points.size(); ++i) {
    of_first += feed.points[i] < 1000 ? 1 : 0;
    if (i > 0) switches += (feed.points[i] < 1000) != (feed.points[i - 1] < 1000) ? 1 : 0;
  }
  EXPECT_LE(switches, 2);
  EXPECT_GE(std::max<int>(of_first, static_cast<int>(feed.points.size()) - of_first), 57);
  ASSERT_FALSE(feed.remarks.empty());
  EXPECT_THAT(feed.remarks.back(), HasSubstr("two producers"));
  EXPECT_GT(feed.counts["live_scans_other_sender"], 50);
}

TEST(ScanStreams, ABeginningSessionCountsFrom0WhateverTheProducerHasSentBefore) {
  Feed feed;
  for (int i = 0; i < 10; ++i) feed.at(i, (std::int64_t{1} << 59) + i);
  EXPECT_EQ(feed.numbers, range(0, 10));
}

}  // namespace
}  // namespace hp2
