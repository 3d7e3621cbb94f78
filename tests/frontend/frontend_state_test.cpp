// Saved states that are not what they should be: an Error, never a crash or an allocation without bound.
#include <array>
#include <cstring>
#include <random>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/frontend/tiny_drive.hpp"

namespace hp2 {
namespace {

using test::tiny_drive;
using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kMapBegins = 3200;  // roughly, in a saved state

const Bytes& good_state() {
  static const Bytes state = [] {
    Frontend frontend(test::short_submaps());
    for (const Scan& scan : tiny_drive().scans) {
      if (frontend.process(scan).finished_submap) break;
    }
    return frontend.save_state();
  }();
  return state;
}

void expect_refused(const Bytes& bytes) {
  Frontend frontend(test::short_submaps());
  EXPECT_THROW(frontend.restore_state(bytes), Error);
}

TEST(FrontendState, TruncatedIsRefused) {
  const Bytes& state = good_state();
  ASSERT_GT(state.size(), 1000U);
  for (std::size_t n = 0; n < 700; n += 5) {
    SCOPED_TRACE(n);
    expect_refused(Bytes(state.begin(), state.begin() + static_cast<std::ptrdiff_t>(n)));
  }
  expect_refused(Bytes(state.begin(), state.end() - 1));
  expect_refused(Bytes(state.begin(), state.begin() + static_cast<std::ptrdiff_t>(state.size() / 2)));
}

TEST(FrontendState, TooLongIsRefused) {
  Bytes state = good_state();
  state.push_back(0);
  expect_refused(state);
}

TEST(FrontendState, OfAnotherVersionIsRefused) {
  Bytes state = good_state();
  state[0] ^= 0x40U;
  EXPECT_THAT(test::error_of([&] { Frontend(test::short_submaps()).restore_state(state); }),
              ::testing::HasSubstr("version"));
}

TEST(FrontendState, OfAnotherVoxelSizeIsRefused) {
  FrontendConfig config = test::short_submaps();
  config.voxel_size_m = 1.2;
  EXPECT_THAT(test::error_of([&] { Frontend(config).restore_state(good_state()); }),
              ::testing::HasSubstr("voxel size"));
}

TEST(FrontendState, RandomBytesAreRefused) {
  std::mt19937 random(1);
  for (int i = 0; i < 100; ++i) {
    Bytes bytes(random() % 3000);
    for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
    // Some with a right beginning, so that what follows is read as well.
    const std::size_t head = i % 2 == 0 ? 0 : std::min<std::size_t>(bytes.size(), 16 + random() % 100);
    std::copy_n(good_state().begin(), head, bytes.begin());
    expect_refused(bytes);
  }
}

TEST(FrontendState, ImpossibleNumbersAreRefusedOrLeaveFinitePoses) {
  // NaN, zero and huge numbers in the place of each number ahead of the motion filter's covariance: poses,
  // intervals, counts; and of some in the covariance.
  for (const std::uint8_t byte : {0xFF, 0x00, 0x7E}) {
    for (std::size_t at = 16; at < kMapBegins; at += at < 560 ? 4 : 76) {
      Bytes bytes = good_state();
      std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), 8, byte);
      Frontend frontend(test::short_submaps());
      try {
        frontend.restore_state(bytes);
      } catch (const Error&) {
        continue;
      }
      const auto o = frontend.process(tiny_drive().scans[30]).odometry;
      EXPECT_TRUE(o.odom_from_sensor.is_finite()) << "byte " << at << " = " << int{byte};
    }
  }
}

TEST(FrontendState, DamagedBytesAreRefusedOrLeaveFinitePoses) {
  // A flipped bit may leave a state that means something. It must never crash the process, nor make poses
  // that are not numbers.
  std::mt19937 random(2);
  for (int i = 0; i < 150; ++i) {
    Bytes bytes = good_state();
    const std::size_t reach = std::array{bytes.size(), std::size_t{700}, kMapBegins}[i % 3];
    for (int k = 0; k < 4; ++k) bytes[random() % reach] = static_cast<std::uint8_t>(random());
    Frontend frontend(test::short_submaps());
    try {
      frontend.restore_state(bytes);
    } catch (const Error&) {
      continue;
    }
    for (std::size_t s = 30; s < 32; ++s) {
      const auto o = frontend.process(tiny_drive().scans[s]).odometry;
      EXPECT_TRUE(o.odom_from_sensor.is_finite()) << "damage " << i;
    }
  }
}

}  // namespace
}  // namespace hp2
