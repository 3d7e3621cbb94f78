// Scores of several estimates side by side, as text, CSV and Markdown.
#pragma once
#include <string>
#include <vector>

#include "common/evaluation/metrics.hpp"

namespace hp2 {

/// Cells of text, the first row the header. Every row has as many cells as the header.
using Table = std::vector<std::vector<std::string>>;

/// One estimate's name and scores.
struct NamedEvaluation {
  std::string name;
  Evaluation evaluation;
};

/// A row an estimate: poses, ATE [m] (rmse, mean, median, max), RPE (m and degrees, rmse), KITTI metric.
Table score_table(const std::vector<NamedEvaluation>& estimates);

/// Columns lined up for a terminal, numbers to the right.
std::string format_text(const Table& table);
/// RFC 4180: cells with a comma, a quote or a line break are quoted.
std::string format_csv(const Table& table);
/// A GitHub table; `|` in a cell is escaped.
std::string format_markdown(const Table& table);

}  // namespace hp2
