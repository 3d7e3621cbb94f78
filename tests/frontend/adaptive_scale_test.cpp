// sigma: initial value, window, lower bound, error formula.
#include "frontend/odometry/adaptive_scale.hpp"

#include <cmath>

#include <gtest/gtest.h>

#include "tests/frontend/made_up_clouds.hpp"

namespace hp2 {
namespace {

TEST(AdaptiveScale, InitialThenRmsOverTheWindow) {
  AdaptiveScale scale(2.0, 0.1, 3);
  EXPECT_EQ(scale.sigma_m(), 2.0);
  scale.add(0.3);
  EXPECT_DOUBLE_EQ(scale.sigma_m(), 0.3);
  scale.add(0.4);
  EXPECT_DOUBLE_EQ(scale.sigma_m(), std::sqrt((0.09 + 0.16) / 2.0));
  scale.add(1.2);
  EXPECT_DOUBLE_EQ(scale.sigma_m(), std::sqrt((0.09 + 0.16 + 1.44) / 3.0));
  scale.add(0.5);  // 0.3 leaves the window
  EXPECT_DOUBLE_EQ(scale.sigma_m(), std::sqrt((0.16 + 1.44 + 0.25) / 3.0));
  for (int i = 0; i < 3; ++i) scale.add(0.001);
  EXPECT_EQ(scale.sigma_m(), 0.1);
}

TEST(AdaptiveScale, IsWiderForAPredictionOverALongerTimeOnly) {
  AdaptiveScale scale(2.0, 0.1, 3);
  for (int i = 0; i < 2; ++i) scale.add(0.3);
  scale.add(0.9, 3.0);  // behind dropped scans
  EXPECT_DOUBLE_EQ(scale.sigma_m(), 0.3);
  EXPECT_DOUBLE_EQ(scale.sigma_m(3.0), 0.9);
  EXPECT_EQ(scale.sigma_m(0.1), 0.1);  // never below the least
}

TEST(AdaptiveScale, ErrorOfAKnownDeviation) {
  const Pose deviation(so3_exp({0.0, 0.06, 0.08}), {0.3, 0.0, -0.4});
  EXPECT_NEAR(AdaptiveScale::error_m(deviation, 50.0), 0.5 + 2.0 * 50.0 * std::sin(0.05), 1e-12);
  EXPECT_EQ(AdaptiveScale::error_m(Pose(), 100.0), 0.0);
}

TEST(AdaptiveScale, SavedAndLoadedItGoesOn) {
  AdaptiveScale a(2.0, 0.1, 4), b(2.0, 0.1, 4);
  for (const double e : {0.3, 0.7, 0.2, 0.9, 0.4}) a.add(e);
  std::vector<std::uint8_t> bytes;
  ByteWriter out(bytes);
  a.save(out);
  ByteReader in(bytes.data(), bytes.data() + bytes.size(), "scale");
  b.load(in);
  EXPECT_EQ(a.sigma_m(), b.sigma_m());
  a.add(1.1);
  b.add(1.1);
  EXPECT_EQ(a.sigma_m(), b.sigma_m());
  ByteReader cut(bytes.data(), bytes.data() + bytes.size() - 3, "scale");
  EXPECT_THROW(b.load(cut), Error);
}

}  // namespace
}  // namespace hp2
