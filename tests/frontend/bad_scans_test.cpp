// Whatever a sensor or a clock delivers: finite poses, a state that says so, remarks in words, no crash.
#include <algorithm>
#include <functional>
#include <limits>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/frontend/tiny_drive.hpp"

namespace hp2 {
namespace {

using test::tiny_drive;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

using Spoil = std::function<void(Scan&)>;

void set_points(Scan& s, std::size_t n, float value) {
  s.x.assign(n, value);
  s.y.assign(n, value);
  s.z.assign(n, value);
  s.time.assign(n, 0.5F);
  s.intensity.clear();
}

// Runs the drive with scans 15, 16 and 17 spoilt; everything must be finite.
struct Spoilt {
  std::vector<OdometryResult> results;
  std::vector<std::string> warnings;
};

Spoilt run_spoilt(const Spoil& spoil) {
  Frontend frontend(test::short_submaps());
  Spoilt out;
  std::size_t scans = 0;
  const auto count = [&](const std::optional<Submap>& m) {
    if (!m) return;
    scans += m->scans.size();
    for (const auto& p : m->points) EXPECT_TRUE(p.allFinite());
  };
  for (std::size_t i = 0; i < tiny_drive().scans.size(); ++i) {
    Scan scan = tiny_drive().scans[i];
    if (i >= 15 && i <= 17) spoil(scan);
    const FrontendOutput o = frontend.process(scan);
    EXPECT_TRUE(o.odometry.odom_from_sensor.is_finite()) << i;
    EXPECT_TRUE(o.odometry.covariance.allFinite()) << i;
    EXPECT_NEAR(o.odometry.odom_from_sensor.rotation.norm(), 1.0, 1e-9);
    EXPECT_EQ(o.odometry.n_points, static_cast<int>(scan.size()));
    out.results.push_back(o.odometry);
    count(o.finished_submap);
    for (auto& w : frontend.take_warnings()) out.warnings.push_back(std::move(w));
  }
  count(frontend.finish());
  EXPECT_EQ(scans, tiny_drive().scans.size());  // bad scans keep their place in the submaps
  // Remarks come once each.
  auto sorted = out.warnings;
  std::sort(sorted.begin(), sorted.end());
  EXPECT_EQ(std::adjacent_find(sorted.begin(), sorted.end()), sorted.end());
  return out;
}

void expect_recovered(const Spoilt& s) {
  for (std::size_t i = 20; i < s.results.size(); ++i) {
    const Pose off = tiny_drive().truth[i].inverse() * s.results[i].odom_from_sensor;
    EXPECT_LT(off.translation.norm(), 0.6) << i;
    EXPECT_NE(s.results[i].state, TrackingState::kLost) << i;
  }
}

TEST(BadScans, WithoutUsablePointsAreLostAndTheDriveGoesOn) {
  const std::vector<std::pair<std::string, Spoil>> cases{
      {"zero points", [](Scan& s) { set_points(s, 0, 0.0F); }},
      {"NaN", [](Scan& s) { set_points(s, 5000, kNan); }},
      {"infinite", [](Scan& s) { set_points(s, 5000, std::numeric_limits<float>::infinity()); }},
      {"1e30", [](Scan& s) { set_points(s, 5000, -1e30F); }},
      {"at the sensor", [](Scan& s) { set_points(s, 5000, 0.0F); }},
      {"one point", [](Scan& s) { set_points(s, 1, 5.0F); }},
      {"one place", [](Scan& s) { set_points(s, 5000, 5.0F); }}};
  for (const auto& [name, spoil] : cases) {
    SCOPED_TRACE(name);
    const Spoilt s = run_spoilt(spoil);
    for (std::size_t i = 15; i <= 17; ++i) EXPECT_EQ(s.results[i].state, TrackingState::kLost) << i;
    expect_recovered(s);
  }
}

TEST(BadScans, SomeBadPointsAreDroppedAndCounted) {
  const Spoilt s = run_spoilt([](Scan& scan) {
    for (std::size_t i = 0; i < scan.size(); i += 10) scan.x[i] = i % 20 == 0 ? kNan : 1e30F;
  });
  for (std::size_t i = 15; i <= 17; ++i) {
    EXPECT_GE(s.results[i].n_dropped, s.results[i].n_points / 10);
    EXPECT_NE(s.results[i].state, TrackingState::kLost);
  }
  expect_recovered(s);
}

TEST(BadScans, FromTheFirstOn) {
  // The very first scans are unusable: the drive begins with the first good one.
  Frontend frontend(test::short_submaps());
  for (std::size_t i = 0; i < tiny_drive().scans.size(); ++i) {
    Scan scan = tiny_drive().scans[i];
    if (i < 3) set_points(scan, i == 0 ? 0 : 100, kNan);
    const OdometryResult o = frontend.process(scan).odometry;
    EXPECT_TRUE(o.odom_from_sensor.is_finite());
    if (i < 3) {
      EXPECT_EQ(o.state, TrackingState::kLost);
    }
    if (i > 3) {
      EXPECT_NE(o.state, TrackingState::kLost);
      const Pose truth = tiny_drive().truth[3].inverse() * tiny_drive().truth[i];
      EXPECT_LT((truth.inverse() * o.odom_from_sensor).translation.norm(), 0.6) << i;
    }
  }
}

TEST(BadScans, OnlyBadOnes) {
  Frontend frontend(test::short_submaps());
  for (int i = 0; i < 5; ++i) {
    Scan scan;
    scan.sequence = i;
    const OdometryResult o = frontend.process(scan).odometry;
    EXPECT_EQ(o.state, TrackingState::kLost);
    EXPECT_TRUE(o.odom_from_sensor.is_finite());
  }
  const auto m = frontend.finish();
  ASSERT_TRUE(m.has_value());
  EXPECT_EQ(m->scans.size(), 5U);
  EXPECT_TRUE(m->points.empty());
}

TEST(BadTimes, InTheSweepAreSaidAndSurvived) {
  const std::vector<std::pair<std::string, Spoil>> cases{
      {"wrong length", [](Scan& s) { s.time.resize(s.size() / 2); }},
      {"too long", [](Scan& s) { s.time.resize(s.size() + 5, 0.5F); }},
      {"all equal", [](Scan& s) { s.time.assign(s.size(), 0.25F); }},
      {"NaN", [](Scan& s) { s.time[s.size() / 2] = kNan; }},
      {"in ms",
       [](Scan& s) {
         for (auto& t : s.time) t *= 100.0F;
       }},
      {"negative",
       [](Scan& s) {
         for (auto& t : s.time) t -= 1.0F;
       }},
      {"duration 0",
       [](Scan& s) {
         s.utime += s.duration_us;
         s.duration_us = 0;
       }},
      {"duration negative",
       [](Scan& s) {
         s.utime += 2 * s.duration_us;
         s.duration_us = -s.duration_us;
       }},
      {"none", [](Scan& s) { s.time.clear(); }}};
  for (const auto& [name, spoil] : cases) {
    SCOPED_TRACE(name);
    const Spoilt s = run_spoilt(spoil);
    ASSERT_EQ(s.warnings.size(), 1U);
    EXPECT_THAT(s.warnings[0], ::testing::HasSubstr("deskew"));
    expect_recovered(s);
  }
  EXPECT_TRUE(run_spoilt([](Scan&) {}).warnings.empty());
}

TEST(BadTimes, StampsThatStandStillOrGoBack) {
  const std::int64_t stuck = tiny_drive().scans[14].utime;
  const std::vector<std::pair<std::string, Spoil>> cases{
      {"standing still", [=](Scan& s) { s.utime = stuck; }},
      {"going back", [](Scan& s) { s.utime -= 5000000; }},
      {"zero", [](Scan& s) { s.utime = 0; }}};
  for (const auto& [name, spoil] : cases) {
    SCOPED_TRACE(name);
    const Spoilt s = run_spoilt(spoil);
    ASSERT_EQ(s.warnings.size(), 1U);
    EXPECT_THAT(s.warnings[0], ::testing::HasSubstr("time stamps"));
  }
}

TEST(BadTimes, AllStampsEqualIsAsIfScansCameEvenly) {
  Frontend frontend(test::short_submaps());
  std::size_t warnings = 0;
  for (std::size_t i = 0; i < tiny_drive().scans.size(); ++i) {
    Scan scan = tiny_drive().scans[i];
    scan.utime = 42;
    const OdometryResult o = frontend.process(scan).odometry;
    const Pose off = tiny_drive().truth[i].inverse() * o.odom_from_sensor;
    EXPECT_LT(off.translation.norm(), 0.6) << i;
    warnings += frontend.take_warnings().size();
  }
  EXPECT_EQ(warnings, 1U);
}

TEST(BadTimes, AGapInTheClockStaysFinite) {
  for (const std::int64_t gap : {std::int64_t{10000000}, std::int64_t{3600} * 1000000}) {
    Frontend frontend(test::short_submaps());
    for (std::size_t i = 0; i < tiny_drive().scans.size(); ++i) {
      Scan scan = tiny_drive().scans[i];
      if (i >= 15) scan.utime += gap;
      const OdometryResult o = frontend.process(scan).odometry;
      ASSERT_TRUE(o.odom_from_sensor.is_finite()) << i;
      ASSERT_TRUE(o.covariance.allFinite()) << i;
    }
  }
}

}  // namespace
}  // namespace hp2
