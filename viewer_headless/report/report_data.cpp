#include <algorithm>
#include <cmath>

#include "viewer_headless/report/report.hpp"
#include "viewer_headless/summary.hpp"

namespace hp2 {

namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostClosures = 1000, kMostStretches = 500;

// Enough digits for a chart, few bytes.
Json rounded(double value) {
  if (!std::isfinite(value)) return nullptr;
  if (value == 0.0) return 0;
  const double unit = std::pow(10.0, std::floor(std::log10(std::abs(value))) - 5);
  return std::round(value / unit) * unit;
}

// [[x, y], ...]: of every stretch of the curve its lowest and its highest point, in their order.
Json thinned(const std::vector<double>& x, const std::vector<double>& y, int points) {
  Json out = Json::array();
  const auto put = [&](std::size_t i) { out.push_back({rounded(x[i]), rounded(y[i])}); };
  const std::size_t n = y.size(), bins = std::max<std::size_t>(1, static_cast<std::size_t>(points) / 2);
  if (n <= 2 * bins) {
    for (std::size_t i = 0; i < n; ++i) put(i);
    return out;
  }
  for (std::size_t b = 0; b < bins; ++b) {
    std::size_t low = b * n / bins, high = low;
    for (std::size_t i = low; i < (b + 1) * n / bins; ++i) {
      if (!(y[i] >= y[low])) low = i;
      if (!(y[i] <= y[high])) high = i;
    }
    put(std::min(low, high));
    if (low != high) put(std::max(low, high));
  }
  return out;
}

// Means of stretches: for curves stacked upon each other, which must share their x.
Json averaged(const std::vector<double>& x, const std::vector<double>& y, int points) {
  Json out = Json::array();
  const std::size_t n = y.size(), bins = std::min<std::size_t>(n, static_cast<std::size_t>(points) / 2);
  for (std::size_t b = 0; b < bins; ++b) {
    double sum = 0;
    const std::size_t first = b * n / bins, last = (b + 1) * n / bins;
    for (std::size_t i = first; i < last; ++i) sum += y[i];
    out.push_back({rounded(x[first]), rounded(sum / static_cast<double>(last - first))});
  }
  return out;
}

// A path seen from above, evenly thinned, its last point kept. Before the points `breaks` (rising) the line
// breaks: [null, null].
Json path(const std::vector<Eigen::Vector2d>& points, int most, const std::vector<std::size_t>& breaks) {
  Json out = Json::array();
  const std::size_t n = points.size(), count = std::min<std::size_t>(n, static_cast<std::size_t>(most));
  auto next = breaks.begin();
  const auto put = [&](std::size_t i) { out.push_back({rounded(points[i].x()), rounded(points[i].y())}); };
  std::size_t drawn = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = count == 1 ? 0 : k * (n - 1) / (count - 1);
    for (; next != breaks.end() && *next <= i; ++next) {
      if (*next == 0 || *next >= n) continue;
      if (drawn + 1 < *next) put(*next - 1);  // both ends of the gap are kept
      out.push_back({nullptr, nullptr});
      if (*next < i) put(*next);
      drawn = *next;
    }
    put(i);
    drawn = i;
  }
  return out;
}

// Stretches of scans that are not tracking: [[from, to, state], ...].
Json stretches(const SessionDigest& digest, const std::vector<double>& times) {
  Json out = Json::array();
  for (std::size_t i = 0; i < digest.scans.size() && out.size() < kMostStretches;) {
    std::size_t j = i;
    while (j < digest.scans.size() && digest.scans[j].state == digest.scans[i].state) ++j;
    if (digest.scans[i].state != TrackingState::kTracking) {
      out.push_back({rounded(times[i]), rounded(times[std::min(j, times.size() - 1)]),
                     digest.scans[i].state == TrackingState::kLost ? "lost" : "degenerate"});
    }
    i = j;
  }
  return out;
}

template <typename Value>
std::vector<double> over_scans(const SessionDigest& digest, const Value& value) {
  std::vector<double> out;
  for (const ScanRecord& scan : digest.scans) out.push_back(value(scan));
  return out;
}

Json accuracy(const GroundTruthComparison& truth, int points, Json& paths) {
  std::vector<double> along;
  std::array<std::vector<double>, 3> axes;
  double travelled = 0;
  for (std::size_t i = 0; i < truth.scans.size(); ++i) {
    const auto at = [&](std::size_t k) -> Eigen::Vector3d {
      return truth.corrected.reference.poses[k].topRightCorner<3, 1>();
    };
    if (i > 0) travelled += (at(i) - at(i - 1)).norm();
    along.push_back(travelled);
    const Eigen::Vector3d error = truth.corrected.aligned.poses[i].topRightCorner<3, 1>() - at(i);
    for (int k = 0; k < 3; ++k) axes[k].push_back(error[k]);
  }
  std::vector<Eigen::Vector2d> reference;
  const Trajectory in_map = transformed(truth.map_from_truth, truth.corrected.reference);
  for (const auto& pose : in_map.poses) reference.emplace_back(pose(0, 3), pose(1, 3));
  paths["ground truth"] = path(reference, points, {});
  return {{"alignment", truth.alignment},
          {"ape", thinned(along, truth.corrected.ate_errors, points)},
          {"ape_odometry", thinned(along, truth.odometry.ate_errors, points)},
          {"x", thinned(along, axes[0], points)},
          {"y", thinned(along, axes[1], points)},
          {"z", thinned(along, axes[2], points)}};
}

Json closures(const SessionView& view, const SessionDigest& digest) {
  Json out = Json::array();
  const auto n = static_cast<std::int64_t>(digest.map_from_submap.size());
  // Accepted ones first, should there be more than the report can hold.
  for (const bool accepted : {true, false}) {
    for (const ClosureRecord& c : view.graph.closures) {
      if (c.accepted != accepted || out.size() >= kMostClosures) continue;
      Json row{{"from", c.from_submap},
               {"to", c.to_submap},
               {"inliers", c.inliers},
               {"overlap", c.overlap < 0 ? Json() : rounded(c.overlap)},
               {"residual", c.residual_m < 0 ? Json() : rounded(c.residual_m)},
               {"distance", rounded(c.from_from_to.translation.norm())},
               {"angle", rounded(rotation_angle(c.from_from_to.rotation) * 180.0 / M_PI)},
               {"accepted", c.accepted},
               {"reason", c.reason}};
      if (c.from_submap >= 0 && c.to_submap >= 0 && c.from_submap < n && c.to_submap < n) {
        const auto& a = digest.map_from_submap[static_cast<std::size_t>(c.from_submap)].translation;
        const auto& b = digest.map_from_submap[static_cast<std::size_t>(c.to_submap)].translation;
        row["line"] = {{rounded(a.x()), rounded(a.y())}, {rounded(b.x()), rounded(b.y())}};
      }
      out.push_back(row);
    }
  }
  return out;
}

}  // namespace

Json report_data(const SessionView& view, const SessionDigest& digest,
                 const std::optional<GroundTruthComparison>& truth, const Json& summary, int points) {
  static const char* const kLevels[] = {"note", "warning", "problem"};
  Json data;
  data["summary"] = summary;
  data["meta"] = view.meta;
  data["remarks"] = Json::array();
  for (const Remark& r : make_remarks(view, digest, summary)) {
    data["remarks"].push_back(
        {{"level", kLevels[static_cast<int>(r.level)]}, {"text", r.text}, {"advice", r.advice}});
  }
  std::vector<Eigen::Vector2d> odometry, corrected;
  for (const ScanRecord& scan : digest.scans) {
    odometry.emplace_back(scan.odom_from_sensor.translation.head<2>());
    corrected.emplace_back(scan.map_from_sensor.translation.head<2>());
  }
  Json paths = Json::object();
  data["accuracy"] = truth ? accuracy(*truth, points, paths) : Json();
  const std::vector<std::size_t> breaks = digest.gaps();
  data["gaps"] = breaks.size();
  paths["odometry"] = path(odometry, points, breaks);
  paths["final"] = path(corrected, points, breaks);
  data["paths"] = paths;
  data["closures"] = closures(view, digest);
  data["closures_total"] = view.graph.closures.size();

  const std::vector<double> times = digest.times_s();
  data["time_label"] = digest.has_times() ? "time [s]" : "scan";
  data["states"] = stretches(digest, times);
  const auto curve = [&](const auto& value) { return thinned(times, over_scans(digest, value), points); };
  std::vector<double> matched_at, alpha;  // the first scan has no map to match, so no ratio
  for (std::size_t i = 0; i < digest.scans.size(); ++i) {
    if (digest.scans[i].diagnostics.iterations == 0) continue;
    matched_at.push_back(times[i]);
    alpha.push_back(digest.scans[i].diagnostics.alpha);
  }
  data["alpha"] = thinned(matched_at, alpha, points);
  data["sigma"] = curve([](const ScanRecord& s) { return s.diagnostics.sigma; });
  data["degeneracy"] = curve([](const ScanRecord& s) { return s.diagnostics.min_eigenvalue_ratio; });
  data["iterations"] = curve([](const ScanRecord& s) { return s.diagnostics.iterations; });
  data["total_ms"] = curve([](const ScanRecord& s) { return s.diagnostics.ms[5]; });
  for (std::size_t k = 0; k + 1 < kStageNames.size(); ++k) {
    data["stages"][kStageNames[k]] =
        averaged(times, over_scans(digest, [&](const ScanRecord& s) { return s.diagnostics.ms[k]; }), points);
  }
  return data;
}

}  // namespace hp2
