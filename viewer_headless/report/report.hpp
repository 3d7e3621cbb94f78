// report.html: one file that opens from disk without a network and shows what ran, how well, and what to
// check.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "viewer_headless/ground_truth.hpp"
#include "viewer_headless/session_digest.hpp"

namespace hp2 {

/// Something that the user should know, and what to do about it.
struct Remark {
  enum class Level { kNote, kWarning, kProblem };
  Level level = Level::kNote;
  std::string text, advice;
};

/// Warnings on the session for the user: losses, skipped scans, degenerate or lost stretches, gaps in the
/// stamps, slow scans, revisits that were not closed, an unfinished session, and the processes' own
/// remarks.
std::vector<Remark> make_remarks(const SessionView& view, const SessionDigest& digest,
                                 const nlohmann::ordered_json& summary);

/// The remarks for summary.json: what and, after it, the advice. Notes are left out.
std::vector<std::string> remark_texts(const std::vector<Remark>& remarks);

/// All that the report's charts and tables show. Curves hold at most about `points` points: of each stretch
/// the lowest and the highest value, so that no spike is lost.
nlohmann::ordered_json report_data(const SessionView& view, const SessionDigest& digest,
                                   const std::optional<GroundTruthComparison>& truth,
                                   const nlohmann::ordered_json& summary, int points);

/// The whole page.
/// @param data     report_data()
/// @param map_jpeg the map seen from above; empty: none
std::string report_html(const nlohmann::ordered_json& data, const std::string& map_jpeg);

}  // namespace hp2
