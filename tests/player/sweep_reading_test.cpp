#include "player/sweep/sweep_reading.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

constexpr double kDegree = M_PI / 180.0;

// Fires `beams` beams at `columns` azimuths from `cut_deg` on.
Scan fired(int beams, int columns, bool clockwise, double cut_deg, bool ring_by_ring, double lost = 0.0) {
  std::mt19937 random(5);
  Scan scan;
  const auto fire = [&](int beam, int column) {
    if (static_cast<double>(random()) / 4294967296.0 < lost) return;
    const double turned = 360.0 * column / columns;
    const double azimuth = kDegree * (cut_deg + (clockwise ? -turned : turned));
    const double elevation = kDegree * (beam - beams / 2);
    const double range = 10.0 + 3.0 * std::sin(3.0 * azimuth);
    scan.x.push_back(static_cast<float>(range * std::cos(elevation) * std::cos(azimuth)));
    scan.y.push_back(static_cast<float>(range * std::cos(elevation) * std::sin(azimuth)));
    scan.z.push_back(static_cast<float>(range * std::sin(elevation)));
  };
  if (ring_by_ring) {
    for (int b = 0; b < beams; ++b)
      for (int c = 0; c < columns; ++c) fire(b, c);
  } else {
    for (int c = 0; c < columns; ++c)
      for (int b = 0; b < beams; ++b) fire(b, c);
  }
  return scan;
}

double degrees_between(double a_rad, double b_deg) {
  return std::abs(std::remainder(a_rad / kDegree - b_deg, 360.0));
}

PointOrder order_of(const Scan& scan) { return order_of_points({&scan, &scan, &scan}); }

TEST(SweepReading, TimeGrowsFromCutInDirectionOfTurn) {
  const SweepReading clockwise{SweepReading::Kind::kAzimuth, true, M_PI};
  EXPECT_NEAR(time_of_azimuth(clockwise, static_cast<float>(M_PI - 0.01)), 0.01 / (2.0 * M_PI), 1e-5);
  EXPECT_NEAR(time_of_azimuth(clockwise, 0.0F), 0.5, 1e-5);
  EXPECT_NEAR(time_of_azimuth(clockwise, static_cast<float>(-M_PI + 0.01)), 1.0 - 0.01 / (2.0 * M_PI), 1e-5);
  const SweepReading counterclockwise{SweepReading::Kind::kAzimuth, false, 0.5 * M_PI};
  EXPECT_NEAR(time_of_azimuth(counterclockwise, static_cast<float>(M_PI)), 0.25, 1e-5);
  EXPECT_NEAR(time_of_azimuth(counterclockwise, 0.0F), 0.75, 1e-5);
}

TEST(SweepReading, PointsThatAreNoNumbersGetSoundTimes) {
  const SweepReading reading{SweepReading::Kind::kAzimuth, true, M_PI};
  EXPECT_EQ(time_of_azimuth(reading, std::nanf("")), 0.0F);
}

TEST(PointOrder, OrderOfFiringTellsDirectionAndCut) {
  for (const bool clockwise : {true, false}) {
    for (const double cut : {180.0, 90.0, -37.0}) {
      const PointOrder order = order_of(fired(32, 900, clockwise, cut, false, 0.3));
      ASSERT_TRUE(order.spins && order.one_turn && order.has_cut) << clockwise << " " << cut;
      EXPECT_EQ(order.clockwise, clockwise);
      EXPECT_LT(degrees_between(order.cut_rad, cut), 3.0);
    }
  }
}

TEST(PointOrder, RingByRingTellsCut) {
  for (const double cut : {180.0, 90.0, -37.0}) {
    const PointOrder order = order_of(fired(32, 900, false, cut, true, 0.3));
    ASSERT_TRUE(order.spins && order.has_cut) << cut;
    EXPECT_FALSE(order.one_turn);
    EXPECT_LT(degrees_between(order.cut_rad, cut), 4.0);
  }
}

TEST(PointOrder, ShuffledPointsDoNotSpin) {
  const Scan in_order = fired(32, 900, true, 180.0, false);
  std::vector<std::size_t> places(in_order.size());
  for (std::size_t i = 0; i < places.size(); ++i) places[i] = i;
  std::shuffle(places.begin(), places.end(), std::mt19937(1));
  Scan scan;
  for (const std::size_t i : places) {
    scan.x.push_back(in_order.x[i]);
    scan.y.push_back(in_order.y[i]);
    scan.z.push_back(in_order.z[i]);
  }
  EXPECT_FALSE(order_of(scan).spins);
}

// Rings whose ends do not show in the elevation, and the first of which sees nothing for `unseen_deg`.
Scan rings_that_begin_unseen(double cut_deg, double unseen_deg) {
  Scan scan = fired(8, 400, false, cut_deg, true);
  std::fill(scan.z.begin(), scan.z.end(), 0.0F);
  const auto unseen = static_cast<std::ptrdiff_t>(400.0 * unseen_deg / 360.0);
  for (auto* axis : {&scan.x, &scan.y, &scan.z}) axis->erase(axis->begin(), axis->begin() + unseen);
  return scan;
}

TEST(PointOrder, CutIsNotWhereTheFirstRingSeesSomethingFirst) {
  const PointOrder whole = order_of(rings_that_begin_unseen(90.0, 0.0));
  ASSERT_TRUE(whole.has_cut);
  EXPECT_LT(degrees_between(whole.cut_rad, 90.0), 1.0);
  EXPECT_FALSE(order_of(rings_that_begin_unseen(90.0, 40.0)).has_cut);
}

}  // namespace
}  // namespace hp2
