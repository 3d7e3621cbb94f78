#include "common/evaluation/trajectory.hpp"

#include <cmath>
#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;

std::string error_of(const std::string& text) {
  try {
    parse_trajectory(text, "file.txt");
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

const std::string kPose = "1 0 0 5 0 1 0 6 0 0 1 7\n";

TEST(TrajectoryFile, KittiIsReadRowByRow) {
  const Trajectory t = parse_trajectory("# comment\n\n0 -1 0 5 1 0 0 6 0 0 1 7\r\n" + kPose, "f");
  ASSERT_EQ(t.size(), 2U);
  EXPECT_FALSE(t.has_times());
  EXPECT_EQ(t.poses[0](0, 1), -1);
  EXPECT_EQ(t.poses[0](1, 0), 1);
  EXPECT_EQ(t.poses[0](2, 3), 7);
}

TEST(TrajectoryFile, TumQuaternionIsXyzw) {
  const double s = std::sqrt(0.5);
  const Trajectory t =
      parse_trajectory("12.5, 1, 2, 3, 0, 0, " + std::to_string(s) + ", " + std::to_string(s), "f");
  ASSERT_EQ(t.size(), 1U);
  EXPECT_EQ(t.times_s[0], 12.5);
  EXPECT_NEAR(t.poses[0](1, 0), 1.0, 1e-9);  // a quarter turn about z takes x to y
  EXPECT_NEAR(t.poses[0](0, 1), -1.0, 1e-9);
}

TEST(TrajectoryFile, ErrorsNameTheLineAndSayWhatToDo) {
  EXPECT_THAT(error_of(""), HasSubstr("empty"));
  EXPECT_THAT(error_of(kPose + "1 2 3\n"), HasSubstr("3 numbers in the line: file.txt, line 2"));
  EXPECT_THAT(error_of("1 2 3 4 5\n"), HasSubstr("12 numbers a line (KITTI) or 8 (TUM"));
  EXPECT_THAT(error_of(kPose + "1 0 0 5 0 1 0 nan 0 0 1 7\n"), HasSubstr("\"nan\" is not a finite number"));
  EXPECT_THAT(error_of("1 0 0 5 0 1 0 6x 0 0 1 7\n"), HasSubstr("\"6x\""));
  EXPECT_THAT(error_of("1 0 0 5 0 1 0 6 0 0 2 7\n"), HasSubstr("no rotation matrix: file.txt, line 1"));
  EXPECT_THAT(error_of("1 0 0 5 0 1 0 6 0 0 -1 7\n"), HasSubstr("no rotation matrix"));
  EXPECT_THAT(error_of("1 0 0 0 0 0 0 0\n"), HasSubstr("quaternion"));
  EXPECT_THAT(error_of("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
              HasSubstr("time does not rise: file.txt, line 2"));
  EXPECT_THROW(read_trajectory("/no/such/file"), Error);
  EXPECT_THROW(read_trajectory("/tmp"), Error);
}

TEST(TrajectoryFile, WhatIsWrittenIsReadBackToTwelveDigits) {
  Trajectory t =
      make_trajectory({Pose(), se3_exp((Vector6d() << 1234.56789, 2, 3, 0.1, -2.0, 0.3).finished())});
  t.times_s = {1547131046.123456, 1547131046.223457};
  for (const auto format : {TrajectoryFormat::kKitti, TrajectoryFormat::kTum}) {
    const Trajectory back = parse_trajectory(format_trajectory(t, format), "f");
    ASSERT_EQ(back.size(), 2U);
    EXPECT_LT((back.poses[1] - t.poses[1]).cwiseAbs().maxCoeff(), 1e-8);
    if (back.has_times()) {
      EXPECT_NEAR(back.times_s[1], t.times_s[1], 5e-7);
    }
  }
}

Trajectory at_times(const std::vector<double>& times) {
  Trajectory t = make_trajectory(std::vector<Pose>(times.size()));
  t.times_s = times;
  for (std::size_t i = 0; i < times.size(); ++i) t.poses[i](0, 3) = times[i];
  return t;
}

TEST(Association, PairsTheNearestTimesWithinTheBound) {
  const Trajectory reference = at_times({0.0, 0.1, 0.2, 0.3, 0.4});
  const auto [a, b] = associate(reference, at_times({0.104, 0.215, 0.399}), {}, "gt", "est");
  ASSERT_EQ(a.size(), 2U);
  EXPECT_EQ(a.times_s, (std::vector<double>{0.1, 0.4}));
  EXPECT_EQ(b.times_s, (std::vector<double>{0.104, 0.399}));
  AssociationOptions shifted;
  shifted.offset_s = 100.0;
  EXPECT_EQ(associate(reference, at_times({-99.9, -99.8}), shifted, "gt", "est").first.times_s,
            (std::vector<double>{0.1, 0.2}));
  // The other way round: the longer one is the estimate.
  shifted.offset_s = -100.0;
  EXPECT_EQ(associate(at_times({0.1}), at_times({100.0, 100.1, 100.2}), shifted, "gt", "est").second.times_s,
            (std::vector<double>{100.1}));
  EXPECT_THROW(associate(reference, at_times({77}), {}, "gt", "est"), Error);
}

TEST(Association, DifferentLengthsWithoutTimesAreAnErrorUnlessTheCommonPartIsWanted) {
  const Trajectory a = make_trajectory(std::vector<Pose>(5)), b = make_trajectory(std::vector<Pose>(3));
  try {
    associate(a, b, {}, "gt.txt", "est.txt");
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("5 and 3 poses"));
    EXPECT_THAT(e.what(), HasSubstr("--common-part"));
  }
  AssociationOptions options;
  options.common_part = true;
  EXPECT_EQ(associate(a, b, options, "gt", "est").first.size(), 3U);
  EXPECT_THROW(associate(at_times({1, 2}), b, options, "gt", "est"), Error);
}

}  // namespace
}  // namespace hp2
