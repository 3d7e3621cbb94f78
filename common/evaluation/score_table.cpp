#include "common/evaluation/score_table.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace hp2 {

namespace {

std::string number(double value, const char* pattern) {
  if (!std::isfinite(value)) return "-";
  char text[64];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

}  // namespace

Table score_table(const std::vector<NamedEvaluation>& estimates) {
  Table table{{"estimate", "poses", "ATE rmse [m]", "mean", "median", "max", "RPE [m]", "RPE [deg]",
               "KITTI t [%]", "KITTI r [deg/100m]", "segments"}};
  for (const auto& [name, e] : estimates) {
    table.push_back({name, std::to_string(e.ate.n), number(e.ate.rmse, "%.4f"), number(e.ate.mean, "%.4f"),
                     number(e.ate.median, "%.4f"), number(e.ate.max, "%.4f"),
                     number(e.rpe_translation.rmse, "%.5f"), number(e.rpe_rotation_deg.rmse, "%.5f"),
                     number(e.kitti.t_percent, "%.4f"), number(e.kitti.r_deg_per_100m, "%.4f"),
                     std::to_string(e.kitti.segments)});
  }
  return table;
}

std::string format_text(const Table& table) {
  if (table.empty()) return "";
  std::vector<std::size_t> widths(table.front().size(), 0);
  for (const auto& row : table) {
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  }
  std::string out;
  for (std::size_t r = 0; r < table.size(); ++r) {
    std::string line, rule;
    for (std::size_t c = 0; c < table[r].size(); ++c) {
      const std::string pad(widths[c] - table[r][c].size(), ' ');
      line += (c == 0 ? "" : "  ") + (c == 0 ? table[r][c] + pad : pad + table[r][c]);
      rule += (c == 0 ? "" : "  ") + std::string(widths[c], '-');
    }
    out += line.substr(0, line.find_last_not_of(' ') + 1) + "\n" + (r == 0 ? rule + "\n" : "");
  }
  return out;
}

std::string format_csv(const Table& table) {
  std::string out;
  for (const auto& row : table) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      if (c > 0) out += ',';
      if (row[c].find_first_of(",\"\r\n") == std::string::npos) {
        out += row[c];
        continue;
      }
      out += '"';
      for (const char ch : row[c]) out += ch == '"' ? std::string("\"\"") : std::string(1, ch);
      out += '"';
    }
    out += '\n';
  }
  return out;
}

std::string format_markdown(const Table& table) {
  std::string out;
  for (std::size_t r = 0; r < table.size(); ++r) {
    std::string rule = "|";
    out += "|";
    for (std::size_t c = 0; c < table[r].size(); ++c) {
      out += ' ';
      for (const char ch : table[r][c]) out += ch == '|' ? std::string("\\|") : std::string(1, ch);
      out += " |";
      rule += c == 0 ? " --- |" : " ---: |";
    }
    out += '\n';
    if (r == 0) out += rule + '\n';
  }
  return out;
}

}  // namespace hp2
