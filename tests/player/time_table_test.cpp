// Files of times as people write them.
#include "player/sweep/time_table.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/player/test_files.hpp"

namespace hp2 {
namespace {

using test::error_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(TimeTable, DatesAreSecondsSince1970) {
  EXPECT_DOUBLE_EQ(parse_date_time("2011-09-26 13:02:25.5"), 1317042145.5);
  EXPECT_DOUBLE_EQ(parse_date_time("2011-09-26T13:02:25.5Z"), 1317042145.5);
  EXPECT_DOUBLE_EQ(parse_date_time("2011/09/26 13:02:25,5"), 1317042145.5);
  EXPECT_DOUBLE_EQ(parse_date_time(" 2011-09-26T15:02:25.5+02:00"), 1317042145.5);
  EXPECT_DOUBLE_EQ(parse_date_time("2011-09-26T08:02:25-0500"), 1317042145.0);
  for (const char* bad : {"", "2011-09-26", "2011-13-26 13:02:25", "2011-09-26x13:02:25",
                          "1317042145.500000000000", "2011-09-26 13:02:25 noon"})
    EXPECT_TRUE(std::isnan(parse_date_time(bad))) << bad;
}

TEST(TimeTable, LinesThatHoldNoTimeAreNamed) {
  const TimeTable table = parse_times("0.1\n0.2\nwhat\n0.4\n", "times.txt");
  ASSERT_EQ(table.times_s.size(), 4U);
  EXPECT_TRUE(std::isnan(table.times_s[2]));
  EXPECT_THAT(table.warnings, ElementsAre(HasSubstr("times.txt line 3 (\"what\")")));
}

TEST(TimeTable, HeaderNamesTheColumn) {
  const TimeTable table = parse_times("id; name; time [s]; x\n7; 3; 0.1; 1\n9; 4; 0.2; 2\n", "t.csv");
  EXPECT_THAT(table.times_s, ElementsAre(0.1, 0.2));
}

TEST(TimeTable, LineNumbersAreNoTimes) {
  EXPECT_TRUE(parse_times("0\n1\n2\n3\n", "t").times_s.empty());
  EXPECT_THAT(parse_times("0\n1\n2\n3\n", "t").warnings, ElementsAre(HasSubstr("counts the scans")));
  EXPECT_EQ(parse_times("0\n1\n2\n3\n", "t", "s").times_s.size(), 4U);
  EXPECT_THAT(parse_times("1 5.0\n2 5.1\n3 5.2\n", "t").times_s, ElementsAre(5.0, 5.1, 5.2));
}

TEST(TimeTable, UnitIsFoundOrGiven) {
  EXPECT_THAT(parse_times("0\n100\n200.5\n", "t").times_s, ElementsAre(0.0, 0.1, 0.2005));
  EXPECT_THAT(parse_times("0\n100\n200.5\n", "t", "s").times_s, ElementsAre(0.0, 100.0, 200.5));
  EXPECT_THAT(error_of([] { parse_times("0\n0.000001\n0.000002\n", "t"); }), HasSubstr("--times-unit"));
  EXPECT_THAT(error_of([] { parse_times("0\n1\n", "t", "hours"); }), HasSubstr("unknown unit"));
}

}  // namespace
}  // namespace hp2
