// Files of times, one scan per line, as people and programs write them.
#pragma once
#include <string>
#include <string_view>
#include <vector>

namespace hp2 {

/// Time [s since 1970] of a date: "2011-09-26 13:02:25.594", with T instead of the blank, "/" instead of "-",
/// Z or an offset such as +02:00 at its end. NaN if it is none.
double parse_date_time(std::string_view text);

/// Times of a file.
struct TimeTable {
  std::vector<double> times_s;        ///< One per line that holds one [s]; NaN: the line holds no time.
  std::vector<std::string> warnings;  ///< Which reading was taken where it is not the plain one.
};

/// Reads times: numbers, dates, or seconds and nanoseconds in two columns. Comments, a header and blank lines
/// are left out. A header names the column ("time", "stamp"); otherwise it is the first that is no line
/// number. The unit is the one that makes the steps those of a LiDAR.
/// @param unit "s", "ms", "us", "ns"; "": find it
/// @throws Error if it cannot be read, or holds times whose steps are a LiDAR's in no unit
TimeTable read_times(const std::string& path, const std::string& unit = "");

/// The same for the text of a file.
TimeTable parse_times(std::string_view text, const std::string& path, const std::string& unit = "");

/// Seconds of "s", "ms", "us", "ns". @throws Error for anything else
double unit_of_name(const std::string& name);

}  // namespace hp2
