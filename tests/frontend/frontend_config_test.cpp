// The configuration section: typos are named, contradictions refused, every mode known.
#include "frontend/frontend_config.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "frontend/frontend.hpp"
#include "tests/frontend/made_up_clouds.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2 {
namespace {

using test::error_of;
using ::testing::AllOf;
using ::testing::HasSubstr;

FrontendConfig load(const std::string& text) {
  FrontendConfig c;
  Config config;
  config.add(frontend_section(c));
  const test::TemporaryFolder folder;
  config.load(folder.write("config.yaml", text));
  return c;
}

TEST(FrontendConfig, ReadsItsSectionAndNamesTypos) {
  const FrontendConfig c = load("frontend:\n  voxel_size_m: 0.77\n  mode: point_to_plane\n  deskew: false\n");
  EXPECT_EQ(c.voxel_size_m, 0.77);
  EXPECT_EQ(c.mode, "point_to_plane");
  EXPECT_FALSE(c.deskew);
  EXPECT_EQ(c.max_range_m, FrontendConfig().max_range_m);
  EXPECT_THAT(error_of([] { load("frontend:\n  voxel_sise_m: 0.5\n"); }),
              AllOf(HasSubstr("voxel_sise_m"), HasSubstr("line 2"), HasSubstr("voxel_size_m\"")));
  EXPECT_THAT(error_of([] { load("frontend:\n  mode: hybird\n"); }), HasSubstr("\"hybrid\""));
  EXPECT_THAT(error_of([] { load("frontend:\n  voxel_size_m: -1\n"); }), HasSubstr("voxel_size_m"));
}

TEST(FrontendConfig, PrintedItReadsBack) {
  FrontendConfig c;
  c.mode = "fixed_alpha";
  c.submap_length_m = 33.25;
  Config config;
  config.add(frontend_section(c));
  const FrontendConfig back = load(config.print());
  EXPECT_EQ(back.mode, "fixed_alpha");
  EXPECT_EQ(back.submap_length_m, 33.25);
  EXPECT_EQ(back.tau_ref, c.tau_ref);
  EXPECT_EQ(back.min_sigma_m, c.min_sigma_m);
}

TEST(FrontendConfig, RefusesCalibrationOfDifferentLengths) {
  FrontendConfig c;
  c.sensor.ring_angles_deg = {-1.0, 1.0};
  c.sensor.ring_range_offsets_m = {0.01};
  EXPECT_THAT(error_of([&] { Frontend{c}; }), AllOf(HasSubstr("ring_range_offsets_m"), HasSubstr("has 2")));
}

TEST(FrontendConfig, DefaultsAndEveryModeAreValid) {
  for (const std::string& mode : frontend_modes()) {
    FrontendConfig c;
    c.mode = mode;
    EXPECT_NO_THROW(validate(c));
    EXPECT_NO_THROW(Frontend{c});
  }
}

TEST(FrontendConfig, ContradictionsAreRefused) {
  FrontendConfig ranges;
  ranges.min_range_m = ranges.max_range_m;
  EXPECT_THAT(error_of([&] { validate(ranges); }), AllOf(HasSubstr("min_range_m"), HasSubstr("max_range_m")));
  EXPECT_THROW(Frontend{ranges}, Error);
  FrontendConfig taus;
  taus.tau_min = 0.3;
  taus.tau_max = 0.2;
  EXPECT_THAT(error_of([&] { validate(taus); }), AllOf(HasSubstr("tau_min"), HasSubstr("tau_max")));
  EXPECT_THROW(Frontend{taus}, Error);
  FrontendConfig mode;
  mode.mode = "robst";
  EXPECT_THAT(error_of([&] { Frontend f(mode); }), HasSubstr("\"robust\""));
}

}  // namespace
}  // namespace hp2
