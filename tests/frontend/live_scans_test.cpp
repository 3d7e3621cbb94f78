#include "frontend/process/live_scans.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/transport/channels.hpp"
#include "tests/transport/fake_bus.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kStart = 1'700'000'000'000'000;

// A driver on one bus, the front-end's side on another.
struct LiveScansTest : public ::testing::Test {
  LiveScansTest() { live.refuse(""); }
  static Scan make(int i) {
    Scan s;
    s.sequence = i;
    s.utime = kStart + 100'000 * i;
    s.duration_us = 100'000;
    s.sensor = "os1";
    s.x = s.y = s.z = {static_cast<float>(i), 1.0F, 2.0F};
    s.time = {0.0F, 0.5F, 1.0F};
    return s;
  }
  void publish(const ByteVector& bytes) {
    driver.publish(kScanChannel, bytes.data(), bytes.size());
    for (int k = 0; k < 20; ++k) {
      network.step(5000);
      live.poll();
      while (auto scan = live.pop()) numbers.push_back(scan->sequence);
    }
  }
  template <class Change>
  void send(int scans, const Change& change) {
    for (int i = 0; i < scans; ++i) {
      Scan scan = make(i);
      change(scan);
      publish(encode_scan(scan));
    }
  }
  std::string only_warning() const {
    return warnings.size() == 1 ? warnings[0] : std::to_string(warnings.size());
  }

  FakeNetwork network;
  FakeBus driver{network}, bus{network};
  Endpoint endpoint{bus};
  std::vector<std::string> warnings;
  LiveScans live{endpoint, 4, [this](const std::string& text) { warnings.push_back(text); }};
  std::vector<std::int64_t> numbers;
};

TEST_F(LiveScansTest, TakesASoundStreamWithoutARemark) {
  send(30, [](Scan&) {});
  EXPECT_EQ(numbers.size(), 30U);
  EXPECT_TRUE(warnings.empty()) << warnings[0];
}

TEST_F(LiveScansTest, NamesStampsInNanoseconds) {
  send(20, [](Scan& s) { s.utime *= 1000; });
  EXPECT_TRUE(numbers.empty());
  EXPECT_EQ(endpoint.counters()["rejected"], 20);
  EXPECT_THAT(only_warning(), HasSubstr("nanoseconds"));
  EXPECT_THAT(only_warning(), HasSubstr("utime"));
}

TEST_F(LiveScansTest, NamesTheUnitOfStampsThatRiseTooSlowlyOrTooFast) {
  struct Case {
    double us;  // of one unit
    const char* name;
  };
  for (const Case& c : {Case{1e3, "milliseconds"}, Case{1e6, "seconds"}, Case{1e-3, "nanoseconds"}}) {
    ScanChecks checks;
    std::vector<std::string> all;
    for (int i = 0; i < 100; ++i) {
      Scan scan = make(i);
      scan.utime = static_cast<std::int64_t>((5e9 + 1e5 * i) / c.us);
      for (auto& text : checks.look_at(scan, 1'000'000 + 100'000 * i)) all.push_back(std::move(text));
    }
    ASSERT_EQ(all.size(), 1U) << c.name;
    EXPECT_THAT(all[0], HasSubstr(std::string("in ") + c.name));
  }
}

TEST_F(LiveScansTest, NamesPointTimesInSeconds) {
  send(20, [](Scan& s) { s.time = {0.0F, 0.05F, 0.0999F}; });
  EXPECT_EQ(numbers.size(), 20U);
  EXPECT_THAT(only_warning(), HasSubstr("in seconds"));
}

TEST_F(LiveScansTest, NamesPointTimesInOtherUnits) {
  send(20, [](Scan& s) { s.time = {0.0F, 5e7F, 9.99e7F}; });
  EXPECT_THAT(only_warning(), HasSubstr("nanoseconds"));
}

TEST_F(LiveScansTest, NamesTheDurationInNanoseconds) {
  send(5, [](Scan& s) { s.duration_us *= 1000; });
  EXPECT_THAT(only_warning(), HasSubstr("duration 100000000"));
}

TEST_F(LiveScansTest, NamesASequenceBelowMinusOne) {
  send(5, [](Scan& s) { s.sequence = -7; });
  EXPECT_THAT(only_warning(), HasSubstr("sequence -7"));
}

TEST_F(LiveScansTest, NamesAnotherTypeAndACutMessageOnceAKind) {
  const ByteVector whole = encode_scan(make(0));
  for (int i = 0; i < 3; ++i) {
    publish(ByteVector(300, 'z'));
    publish(ByteVector(whole.begin(), whole.end() - 5));
  }
  ASSERT_EQ(warnings.size(), 2U);
  EXPECT_THAT(warnings[0], HasSubstr("fingerprint"));
  EXPECT_THAT(warnings[1], HasSubstr("do not hold"));
  EXPECT_EQ(endpoint.counters()["rejected"], 6);
}

TEST_F(LiveScansTest, CountsAndNamesWhyScansAreRefused) {
  live.refuse("a player plays");
  send(5, [](Scan&) {});
  EXPECT_EQ(endpoint.counters()["live_scans_refused"], 5);
  EXPECT_THAT(only_warning(), HasSubstr("a player plays"));
}

TEST_F(LiveScansTest, CountsWhatTheBacklogDrops) {
  for (int i = 0; i < 10; ++i) {
    const ByteVector bytes = encode_scan(make(i));
    driver.publish(kScanChannel, bytes.data(), bytes.size());
    network.step(100'000);
  }
  EXPECT_EQ(endpoint.counters()["live_scans_dropped"], 6);
}

TEST(ScanFault, NamesScanAndLimitOfTooManyPoints) {
  scan_t m{};
  m.sequence = 7;
  m.n = static_cast<std::int32_t>(kMaxScanPoints) + 1;
  m.x.resize(static_cast<std::size_t>(m.n));
  m.y = m.z = m.x;
  m.n_intensity = m.n_time = 0;
  const ByteVector bytes = encode_message(m);
  ASSERT_FALSE(decode_scan(bytes.data(), bytes.size()));
  const std::string fault = scan_fault(bytes.data(), bytes.size());
  EXPECT_THAT(fault, HasSubstr("scan 7 has 4000001 points"));
  EXPECT_THAT(fault, HasSubstr("at most 4000000"));
}

}  // namespace
}  // namespace hp2
