// One wrong stamp costs no other scan anything.
#include "player/sweep/stamp_mender.hpp"

#include <cmath>
#include <limits>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/time_unit.hpp"

namespace hp2 {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// n stamps at 10 Hz from 1000 s on.
std::vector<double> even(std::size_t n) {
  std::vector<double> times;
  for (std::size_t i = 0; i < n; ++i) times.push_back(1000.0 + 0.1 * static_cast<double>(i));
  return times;
}

/// Whether the scans' stamps lie within 60 ms of even(n)'s, in the same order.
void expect_even(const MendedStamps& mended, std::size_t n) {
  ASSERT_EQ(mended.stamps_us.size(), n);
  for (std::size_t i = 0; i < n; ++i) {
    EXPECT_EQ(mended.order[i], i);
    EXPECT_NEAR(static_cast<double>(mended.stamps_us[i]) * 1e-6, even(n)[i], 0.06) << i;
  }
}

TEST(StampMender, LeavesGoodStampsAlone) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> jitter(-0.03, 0.03);
  std::vector<double> times = even(200);
  for (double& t : times) t += jitter(random);
  times.erase(times.begin() + 50, times.begin() + 57);  // scans are missing
  times.erase(times.begin() + 20);
  const MendedStamps mended = mend_stamps(times, "t");
  EXPECT_TRUE(mended.warnings.empty());
  ASSERT_EQ(mended.stamps_us.size(), times.size());
  for (std::size_t i = 0; i < times.size(); ++i) EXPECT_EQ(mended.stamps_us[i], std::llround(times[i] * 1e6));
}

TEST(StampMender, ReplacesOneWrongStampWhereverItIs) {
  for (const double wrong : {kNone, 0.0, 1e300, 5e9, -3.0, 900.0, 1100.0, 1000.33, 1001.27, 1000.9, 1000.0}) {
    for (std::size_t at = 0; at < 20; ++at) {
      std::vector<double> times = even(20);
      if (std::abs(times[at] - wrong) < 0.08) continue;  // within what a clock jitters
      times[at] = wrong;
      SCOPED_TRACE(testing::Message() << wrong << " at " << at);
      const bool is_last = at == 19 && wrong > 1000.0 && wrong < 1200.0;  // a gap, for all one can tell
      if (is_last) continue;
      const MendedStamps mended = mend_stamps(times, "t");
      expect_even(mended, 20);
      ASSERT_EQ(mended.warnings.size(), 1U);
    }
  }
}

TEST(StampMender, SortsScansThatCameOutOfOrder) {
  std::vector<double> times = even(20);
  std::swap(times[8], times[9]);
  std::swap(times[0], times[1]);
  std::swap(times[18], times[19]);
  const MendedStamps mended = mend_stamps(times, "bag");
  ASSERT_EQ(mended.stamps_us.size(), 20U);
  EXPECT_EQ(mended.order[8], 9U);
  EXPECT_EQ(mended.order[0], 1U);
  EXPECT_EQ(mended.order[18], 19U);
  EXPECT_EQ(mended.stamps_us[8], 1'000'800'000);
  EXPECT_THAT(mended.warnings, ElementsAre(HasSubstr("3 scans (scans 1, 9, 19) out of order")));

  times = even(20);
  const double late = times[5];
  times.erase(times.begin() + 5);
  times.insert(times.begin() + 9, late);  // four scans too late
  const MendedStamps moved = mend_stamps(times, "bag");
  EXPECT_EQ(moved.order[5], 9U);
  EXPECT_EQ(moved.stamps_us[5], 1'000'500'000);
}

TEST(StampMender, KeepsOrderWhereItIsCertain) {
  std::vector<double> times = even(20);
  std::swap(times[8], times[9]);
  MendOptions options;
  options.may_reorder = false;
  const MendedStamps mended = mend_stamps(times, "frames", options);
  for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(mended.order[i], i);
  for (std::size_t i = 1; i < 20; ++i) EXPECT_LT(mended.stamps_us[i - 1], mended.stamps_us[i]);
}

TEST(StampMender, LeavesOutCopiesOnly) {
  const std::vector<double> times = {1.0, 1.0, 1.1, 1.1, 1.2, 1.2, 1.3, 1.301, 1.4, 1.4, 1.5};
  const std::vector<int> points = {0, 0, 1, 1, 2, 2, 3, 3, 4, 99, 5};
  MendOptions options;
  options.same_points = [&](std::size_t a, std::size_t b) { return points[a] == points[b]; };
  const MendedStamps mended = mend_stamps(times, "log", options);
  EXPECT_THAT(mended.order, ElementsAre(0, 2, 4, 6, 8, 9, 10));
  EXPECT_THAT(mended.warnings, ElementsAre(HasSubstr("1 stamp"),
                                           HasSubstr("4 scans (scans 1, 3, 5, ...) with the same stamp")));
}

TEST(StampMender, GoesOnAfterTheClockStepsBack) {
  for (const double step : {0.35, 2.0, 3600.0, 1e9}) {
    std::vector<double> times = even(40);
    for (std::size_t i = 20; i < 40; ++i) times[i] -= step;
    const MendedStamps mended = mend_stamps(times, "t");
    expect_even(mended, 40);
    EXPECT_THAT(mended.warnings, ElementsAre(HasSubstr("the clock steps back 1 time (scan 20)"))) << step;
  }
}

TEST(StampMender, KeepsStampsOnBothSidesOfAJumpAhead) {
  for (const double step : {37.0, 1.6e9}) {
    std::vector<double> times = even(40);
    for (std::size_t i = 20; i < 40; ++i) times[i] += step;
    const MendedStamps mended = mend_stamps(times, "t");
    EXPECT_EQ(mended.stamps_us[39], std::llround(times[39] * 1e6));
    EXPECT_THAT(mended.warnings, ElementsAre(HasSubstr("jump ahead 1 time (scan 20)")));
  }
}

TEST(StampMender, ReplacesStampsOfAClockThatIsNotSetYet) {
  std::vector<double> times = even(40);
  for (std::size_t i = 0; i < 3; ++i) times[i] = 0.1 * static_cast<double>(i);
  expect_even(mend_stamps(times, "t"), 40);
}

TEST(StampMender, SpreadsStampsOfFewDigits) {
  std::vector<double> times;
  for (int i = 0; i < 95; ++i) times.push_back(std::floor(1.7e9 + 0.1 * i));
  const MendedStamps mended = mend_stamps(times, "t");
  EXPECT_NEAR(static_cast<double>(mended.stamps_us[94] - mended.stamps_us[0]), 9e6, 1.0);
  EXPECT_NEAR(static_cast<double>(mended.stamps_us[1] - mended.stamps_us[0]), 9e6 / 94, 1.0);
}

TEST(StampMender, AssumesTenHertzForStampsOfNoUse) {
  for (const std::vector<double>& times :
       {std::vector<double>(5, 7.0), std::vector<double>(5, kNone), std::vector<double>(5, 0.0)}) {
    const MendedStamps mended = mend_stamps(times, "t");
    EXPECT_THAT(mended.stamps_us, ElementsAre(0, 100'000, 200'000, 300'000, 400'000));
    EXPECT_THAT(mended.warnings, ElementsAre(HasSubstr("10 scans a second")));
  }
  EXPECT_TRUE(mend_stamps({}, "t").stamps_us.empty());
  EXPECT_THAT(mend_stamps({42.0}, "t").stamps_us, ElementsAre(42'000'000));
}

TEST(StampMender, StampsRiseAndNoScanIsLostWhateverTheStamps) {
  std::mt19937 random(3);
  for (int k = 0; k < 2000; ++k) {
    std::vector<double> times = even(1 + random() % 40);
    for (double& t : times) {
      if (random() % 3 != 0) continue;
      const double values[] = {kNone, 0.0, -1e12, 4e12, 1e-9, 1000.0, t + 0.1, t - 0.25, INFINITY};
      t = values[random() % 9];
    }
    const MendedStamps mended = mend_stamps(times, "t");
    ASSERT_EQ(mended.order.size(), times.size());
    ASSERT_EQ(mended.stamps_us.size(), times.size());
    for (std::size_t i = 1; i < times.size(); ++i) ASSERT_LT(mended.stamps_us[i - 1], mended.stamps_us[i]);
  }
}

TEST(TimeUnit, IsTheOneThatMakesStepsPlausible) {
  for (const double step_s : {0.006, 0.05, 0.1, 0.25, 1.0, 1.9})
    for (const double unit : {1.0, 1e-3, 1e-6, 1e-9}) {
      std::vector<double> times;
      for (int i = 0; i < 10; ++i) times.push_back((1.6e9 + step_s * i) / unit);
      times[4] = kNone;
      EXPECT_EQ(unit_of_stamps(times), unit) << step_s;
    }
  EXPECT_EQ(unit_of_stamps({0, 1e-5, 2e-5}), 0.0);
  EXPECT_EQ(unit_of_stamps({1, 1, 1}), 0.0);
  EXPECT_EQ(unit_of_stamps({}), 0.0);
}

TEST(TimeUnit, OfTrajectoriesLeavesLongStepsAlone) {
  EXPECT_EQ(unit_of_trajectory({1.7e9, 1.7e9 + 60, 1.7e9 + 120}), 1.0);
  EXPECT_EQ(unit_of_trajectory({0, 20, 40}), 1.0);
  EXPECT_EQ(unit_of_trajectory({1.7e18, 1.7e18 + 1e8}), 1e-9);
  EXPECT_EQ(unit_of_trajectory({1.7e15, 1.7e15 + 1e5}), 1e-6);
  EXPECT_EQ(unit_of_trajectory({1.7e12, 1.7e12 + 100}), 1e-3);
  EXPECT_EQ(unit_of_trajectory({0, 1e8, 2e8}), 1e-9);
}

}  // namespace
}  // namespace hp2
