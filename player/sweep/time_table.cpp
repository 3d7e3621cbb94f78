#include "player/sweep/time_table.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>

#include <fmt/format.h>

#include "common/error.hpp"
#include "common/time_unit.hpp"
#include "player/readers/file_io.hpp"

namespace hp2 {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kMostHeaderLines = 10;
constexpr double kLargestTime = 1e19;  // nanoseconds of 300 years

/// Days from 1970-01-01 to a date of the Gregorian calendar.
std::int64_t days_since_1970(std::int64_t year, int month, int day) {
  year -= month <= 2;  // years begin in March, so that leap days come last
  const std::int64_t era = year / 400;
  const std::int64_t year_of_era = year % 400;
  const std::int64_t day_of_year = (153 * (month + (month > 2 ? -3 : 9)) + 2) / 5 + day - 1;
  return era * 146097 + year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year - 719468;
}

/// Seconds of "Z", "+02:00", "-0530", "+01" or nothing; NaN if it is none of these.
double zone_offset(std::string_view zone) {
  if (zone.empty() || zone == "Z" || zone == "z") return 0.0;
  if (zone[0] != '+' && zone[0] != '-') return kNone;
  std::string digits;
  for (const char c : zone.substr(1))
    if (c != ':') digits += c;
  int value = 0;
  const auto [rest, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || rest != digits.data() + digits.size() ||
      (digits.size() != 2 && digits.size() != 4))
    return kNone;
  const int minutes = digits.size() == 2 ? value * 60 : value / 100 * 60 + value % 100;
  return (zone[0] == '-' ? -60.0 : 60.0) * minutes;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (std::isspace(static_cast<unsigned char>(text.front())) || text.front() == '"'))
    text.remove_prefix(1);
  while (!text.empty() && (std::isspace(static_cast<unsigned char>(text.back())) || text.back() == '"'))
    text.remove_suffix(1);
  return text;
}

bool is_comment(std::string_view line) {
  return line.empty() || line[0] == '#' || line[0] == '%' || line.substr(0, 2) == "//";
}

/// Column whose name in a header speaks of time; -1 if none does.
int column_named_time(std::string_view header) {
  int column = 0;
  std::string word;
  const auto speaks_of_time = [&word] {
    return word.find("time") != std::string::npos || word.find("stamp") != std::string::npos;
  };
  bool in_word = false;
  for (const char c : header) {
    const bool separator = std::string_view(" \t,;").find(c) != std::string_view::npos;
    if (separator && (in_word || c == ',' || c == ';')) {
      if (speaks_of_time()) return column;
      word.clear();
      ++column;
      in_word = false;
    } else if (!separator) {
      word += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
      in_word = true;
    }
  }
  return speaks_of_time() ? column : -1;
}

double value_at(const std::vector<double>& row, std::size_t column) {
  return column < row.size() ? row[column] : kNone;
}

/// Whether a column counts the lines, from 0 or from 1.
bool counts_lines(const std::vector<std::vector<double>>& rows, std::size_t column) {
  const double first = value_at(rows.front(), column);
  if (first != 0.0 && first != 1.0) return false;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (value_at(rows[i], column) != first + static_cast<double>(i)) return false;
  return rows.size() > 2;
}

/// Whether columns 0 and 1 are whole seconds and nanoseconds.
bool is_seconds_and_nanoseconds(const std::vector<std::vector<double>>& rows) {
  bool repeats = false;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double s = value_at(rows[i], 0), ns = value_at(rows[i], 1);
    if (s != std::floor(s) || ns != std::floor(ns) || ns < 0.0 || ns >= 1e9) return false;
    repeats = repeats || ns >= 1e6 || (i > 0 && s == value_at(rows[i - 1], 0));
  }
  return repeats && rows.size() > 1 && rows.front().size() == 2 && !counts_lines(rows, 0);
}

/// The times of rows of numbers, in their own unit.
std::vector<double> pick_times(const std::vector<std::vector<double>>& rows, int named_column,
                               const std::string& path, TimeTable& table) {
  std::vector<double> times;
  if (named_column < 0 && is_seconds_and_nanoseconds(rows)) {
    table.warnings.push_back(path + " is read as seconds and nanoseconds in two columns");
    for (const auto& row : rows) times.push_back(row[0] + 1e-9 * row[1]);
    return times;
  }
  std::size_t column = named_column < 0 ? 0 : static_cast<std::size_t>(named_column);
  if (named_column < 0 && rows.front().size() > 1 && counts_lines(rows, 0)) column = 1;
  if (column > 0)
    table.warnings.push_back(fmt::format("{}: the times are those of column {}", path, column + 1));
  for (const auto& row : rows) times.push_back(value_at(row, column));
  return times;
}

std::size_t finite_count(const std::vector<double>& values) {
  return static_cast<std::size_t>(
      std::count_if(values.begin(), values.end(), [](double v) { return std::isfinite(v); }));
}

/// Turns times into seconds.
void apply_unit(const std::string& unit, const std::string& path, TimeTable& table) {
  if (!unit.empty()) {
    for (double& t : table.times_s) t *= unit_of_name(unit);
    return;
  }
  for (double& t : table.times_s)
    if (std::abs(t) > kLargestTime) t = kNone;
  const double found = unit_of_stamps(table.times_s);
  if (found == 1.0 || (found == 0.0 && finite_count(table.times_s) < 2)) return;
  if (found == 0.0) {
    const bool rises = std::is_sorted(table.times_s.begin(), table.times_s.end(), std::less_equal<>()) &&
                       table.times_s.front() < table.times_s.back();
    if (!rises) return;  // of no use in any unit: the scans' clock is made anew, and that is reported
    throw Error(
        fmt::format(
            "the times rise by {:g} per scan, which is no LiDAR's step in s, ms, us or ns",
            (table.times_s.back() - table.times_s.front()) / static_cast<double>(table.times_s.size() - 1)),
        path, "Write seconds, name the unit with --times-unit, or remove the file (10 Hz is assumed then).");
  }
  for (double& t : table.times_s) t *= found;
  table.warnings.push_back(fmt::format("{} is read as {}: no other unit makes the steps those of a LiDAR",
                                       path, name_of_unit(found)));
}

}  // namespace

double parse_date_time(std::string_view text) {
  text = trimmed(text);
  int parts[5] = {};
  const std::size_t begins[5] = {0, 5, 8, 11, 14};
  const std::size_t lengths[5] = {4, 2, 2, 2, 2};
  if (text.size() < 19) return kNone;
  for (int i = 0; i < 5; ++i) {
    const char* first = text.data() + begins[i];
    const auto [rest, error] = std::from_chars(first, first + lengths[i], parts[i]);
    if (error != std::errc() || rest != first + lengths[i]) return kNone;
  }
  const char separator = text[10];
  if ((text[4] != '-' && text[4] != '/') ||
      (separator != ' ' && separator != 'T' && separator != 't' && separator != '_'))
    return kNone;
  std::size_t end = 17;
  while (end < text.size() &&
         (std::isdigit(static_cast<unsigned char>(text[end])) || text[end] == '.' || text[end] == ','))
    ++end;
  std::string seconds_text(text.substr(17, end - 17));
  std::replace(seconds_text.begin(), seconds_text.end(), ',', '.');
  double seconds = 0.0;
  const auto [rest, error] =
      std::from_chars(seconds_text.data(), seconds_text.data() + seconds_text.size(), seconds);
  const double offset = zone_offset(trimmed(text.substr(end)));
  if (parts[0] < 1970 || parts[1] < 1 || parts[1] > 12 || parts[2] < 1 || parts[2] > 31 ||
      error != std::errc() || rest != seconds_text.data() + seconds_text.size() || std::isnan(offset))
    return kNone;
  const std::int64_t minutes =
      (days_since_1970(parts[0], parts[1], parts[2]) * 24 + parts[3]) * 60 + parts[4];
  return static_cast<double>(minutes) * 60.0 + seconds - offset;
}

double unit_of_name(const std::string& name) {
  if (name == "s") return 1.0;
  if (name == "ms") return 1e-3;
  if (name == "us") return 1e-6;
  if (name == "ns") return 1e-9;
  throw Error("unknown unit of time '" + name + "'", "--times-unit", "Known are s, ms, us and ns.");
}

TimeTable parse_times(std::string_view text, const std::string& path, const std::string& unit) {
  TimeTable table;
  std::vector<std::vector<double>> rows;
  std::vector<double> dates;
  std::size_t header_lines = 0, n_dates = 0, line_number = 0;
  std::string bad_line;
  int named_column = -1;
  for (std::string_view line : split_lines(text)) {
    ++line_number;
    line = trimmed(line);
    if (is_comment(line)) continue;
    const double date = parse_date_time(line);
    std::vector<double> numbers = parse_numbers(line);
    if (std::isnan(date) && finite_count(numbers) == 0) {
      const bool is_header =
          rows.empty() && header_lines < kMostHeaderLines &&
          std::any_of(line.begin(), line.end(),
                      [](char c) { return std::isalpha(static_cast<unsigned char>(c)); }) &&
          line.substr(0, 3) != "nan" && line.substr(0, 3) != "inf";
      if (is_header) {
        ++header_lines;
        named_column = column_named_time(line);
        continue;
      }
      if (bad_line.empty())
        bad_line = fmt::format("{} line {} (\"{}\")", path, line_number, line.substr(0, 30));
    }
    n_dates += std::isnan(date) ? 0 : 1;
    dates.push_back(date);
    rows.push_back(std::move(numbers));
  }
  if (rows.empty()) return table;
  if (!bad_line.empty()) table.warnings.push_back(bad_line + " holds no time");
  if (2 * n_dates > rows.size()) {
    table.times_s = std::move(dates);
    return table;
  }
  if (rows.front().size() == 1 && counts_lines(rows, 0) && unit.empty()) {
    table.warnings.push_back(
        path + " counts the scans and holds no times (if they are seconds, say --times-unit s)");
    return table;
  }
  table.times_s = pick_times(rows, named_column, path, table);
  apply_unit(unit, path, table);
  return table;
}

TimeTable read_times(const std::string& path, const std::string& unit) {
  return parse_times(read_text(path), path, unit);
}

}  // namespace hp2
