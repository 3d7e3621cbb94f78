// summary.json: what ran, what came of it, how long it took and what was lost.
#pragma once
#include <array>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "viewer_headless/ground_truth.hpp"
#include "viewer_headless/session_digest.hpp"

namespace hp2 {

/// Names of the stages in ScanDiagnostics::ms, in order; the last one is the total.
extern const std::array<const char*, 6> kStageNames;

/// scans_in, poses_out, scans_skipped (never registered, by overload or gaps), scans_lost (in neither),
/// submaps, closures, states, milliseconds a stage (mean, median, p99, max), scans_per_s, peak_memory_mb,
/// versions, counters, configuration, accuracy (with ground truth). What is not known is null.
nlohmann::ordered_json make_summary(const SessionView& view, const SessionDigest& digest,
                                    const std::optional<GroundTruthComparison>& truth,
                                    std::int64_t map_points);

/// JSON text in which bytes that are no UTF-8 are replaced, and numbers that are not finite are null.
std::string dump(const nlohmann::ordered_json& json, int indent = 2);

}  // namespace hp2
