#include <algorithm>
#include <cmath>
#include <cstdio>

#include "viewer_headless/report/report.hpp"

namespace hp2 {

namespace {

using Json = nlohmann::ordered_json;
using Level = Remark::Level;

constexpr double kRevisitM = 10.0, kRevisitPathM = 150.0;

template <typename... T>
std::string text(const char* pattern, T... values) {
  char buffer[400];
  std::snprintf(buffer, sizeof buffer, pattern, values...);
  return buffer;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

void remark_losses(const Json& summary, std::vector<Remark>& out) {
  const auto lost = summary.at("scans_lost").get<long long>(),
             skipped = summary.at("scans_skipped").get<long long>();
  if (lost > 0) {
    out.push_back({Level::kProblem,
                   text("%lld %s no pose.", lost,
                        lost == 1 ? "scan that was played has" : "scans that were played have"),
                   "If the session is still running they may be in the open submap; otherwise run again with "
                   "--rate max, where "
                   "every scan is acknowledged."});
  }
  if (skipped > 0) {
    out.push_back({Level::kWarning,
                   text("%lld %s skipped: faster than scans could be registered, or missing in the stream.",
                        skipped, skipped == 1 ? "scan was" : "scans were"),
                   "Use a lower --rate or --rate max, more --threads, or a larger voxel_size_m."});
  }
  for (const auto& [process, counters] : summary.at("counters").items()) {
    if (!counters.is_object()) continue;
    const auto rejected = counters.find("rejected");  // messages; closures_rejected are none
    if (rejected == counters.end() || !rejected->is_number() || rejected->get<double>() <= 0) continue;
    out.push_back(
        {Level::kWarning,
         process + " rejected " + rejected->dump() +
             (rejected->get<double>() == 1 ? " message." : " messages."),
         "The log of the process and the remarks here tell which and why. A driver of one's own that fills a "
         "message wrongly is as likely as another program on the same LCM channels."});
  }
}

// Scans that the player has not played, or could not read.
void remark_missing(const SessionDigest& digest, const Json& summary, std::vector<Remark>& out) {
  const auto damaged = summary.value("scans_damaged", 0LL);
  if (damaged > 0) {
    out.push_back({Level::kProblem,
                   text("%lld scan%s could not be read: left out.", damaged, damaged == 1 ? "" : "s"),
                   "Mend or copy the files again, then run with --overwrite."});
  }
  const auto& processes = summary.at("processes");
  if (!processes.is_object() || !processes.contains("hp2_player")) return;
  const auto total = processes["hp2_player"].value("total", -1LL);
  const auto done = digest.scans.empty() ? 0LL : static_cast<long long>(digest.scans.back().sequence) + 1;
  if (total > done) {
    out.push_back({Level::kProblem, text("The last %lld of %lld scans are missing.", total - done, total),
                   "The player was stopped or could not read on: its log tells where. The same command plays "
                   "the drive again."});
  }
}

void remark_tracking(const Json& summary, std::vector<Remark>& out) {
  const double poses = std::max(1.0, summary.at("poses_out").get<double>());
  const auto lost = summary.at("states").at("lost").get<long long>();
  const auto degenerate = summary.at("states").at("degenerate").get<long long>();
  if (lost > 0) {
    out.push_back({Level::kProblem,
                   text("Tracking was lost in %lld %s (%.1f %%): %s.", lost, lost == 1 ? "scan" : "scans",
                        100.0 * static_cast<double>(lost) / poses,
                        lost == 1 ? "its pose is a prediction" : "their poses are predictions"),
                   "Look at the red stretches below. Missing scans, a covered sensor or very fast turns are "
                   "the usual causes; check the "
                   "time stamps and the sensor's rate."});
  }
  if (static_cast<double>(degenerate) > 0.05 * poses) {
    out.push_back({Level::kWarning,
                   text("In %lld %s (%.1f %%) the surroundings did not determine all directions.", degenerate,
                        degenerate == 1 ? "scan" : "scans", 100.0 * static_cast<double>(degenerate) / poses),
                   "Long tunnels, bridges and open fields do that. Expect drift along the road there; a "
                   "larger max_range_m or a "
                   "sensor that sees more sideways helps."});
  }
}

void remark_times(const SessionDigest& digest, const Json& summary, std::vector<Remark>& out) {
  if (digest.scans.size() < 3) return;
  if (!digest.has_times()) {
    out.push_back({Level::kWarning, "The time stamps do not rise from scan to scan.",
                   "The charts below count scans instead. Check times.txt or the driver's clock: the motion "
                   "prediction depends on it."});
    return;
  }
  std::vector<double> steps;
  for (std::size_t i = 1; i < digest.scans.size(); ++i) {
    steps.push_back(1e-6 * static_cast<double>(digest.scans[i].utime - digest.scans[i - 1].utime));
  }
  const double usual = median(steps);
  const auto gaps = std::count_if(steps.begin(), steps.end(), [&](double s) { return s > 2.5 * usual; });
  if (gaps > 0) {
    out.push_back(
        {Level::kWarning,
         gaps == 1 ? text("There is 1 gap in the stream, of %.2f s (usual: %.3f s).",
                          *std::max_element(steps.begin(), steps.end()), usual)
                   : text("There are %ld gaps in the stream; the longest lasts %.2f s (usual: %.3f s).",
                          static_cast<long>(gaps), *std::max_element(steps.begin(), steps.end()), usual),
         "Scans are missing in the data, or were skipped. Over a long gap in a turn tracking can be lost."});
  }
  const auto& total = summary.at("milliseconds").at("total");
  if (total.at("p99").is_number() && total.at("p99").get<double>() > 1000.0 * usual) {
    out.push_back(
        {Level::kWarning,
         text("One scan in a hundred takes longer (%.0f ms) than the sensor takes for it (%.0f ms).",
              total.at("p99").get<double>(), 1000.0 * usual),
         "Live, scans would be skipped. Use more --threads or a larger voxel_size_m."});
  }
}

// A place seen again that no closure ties: from the final poses, thinned out to one in 5 m.
void remark_revisits(const SessionView& view, const SessionDigest& digest, std::vector<Remark>& out) {
  for (const auto& c : view.graph.closures) {
    if (c.accepted) return;
  }
  std::vector<Eigen::Vector3d> places;
  std::vector<double> path;
  double travelled = 0;
  for (std::size_t i = 0; i < digest.scans.size(); ++i) {
    const Eigen::Vector3d& here = digest.scans[i].map_from_sensor.translation;
    if (i > 0) travelled += (here - digest.scans[i - 1].map_from_sensor.translation).norm();
    if (places.empty() || (here - places.back()).norm() > 5.0) {
      places.push_back(here);
      path.push_back(travelled);
    }
  }
  constexpr std::size_t kMost = 4000;  // 20 km; the search below is quadratic
  const std::size_t n = std::min(places.size(), kMost);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if (path[j] - path[i] < kRevisitPathM || (places[i] - places[j]).norm() > kRevisitM) continue;
      out.push_back({Level::kWarning,
                     "The drive comes back to a place that it has seen, but no loop closure was accepted.",
                     "closures.csv says why each candidate was refused. The trajectory is the odometry's, "
                     "with its drift."});
      return;
    }
  }
}

}  // namespace

std::vector<Remark> make_remarks(const SessionView& view, const SessionDigest& digest, const Json& summary) {
  std::vector<Remark> out;
  if (digest.scans.empty() && view.graph.ended) {
    out.push_back({Level::kProblem, "The session has ended without a pose.",
                   "Every scan was refused, or none came: the warnings here and the logs tell why."});
  } else if (digest.scans.empty()) {
    out.push_back({Level::kProblem, "The session holds no scan yet.",
                   "Start the player, or wait until the first submap is finished."});
  } else if (!view.graph.ended) {
    out.push_back({Level::kNote,
                   "The session is not finished: this is how it stood when the report was written.",
                   "Poses may still move with later loop closures, and the open submap is missing."});
  }
  remark_missing(digest, summary, out);
  remark_losses(summary, out);
  remark_tracking(summary, out);
  remark_times(digest, summary, out);
  remark_revisits(view, digest, out);
  for (const auto& warning : view.warnings) out.push_back({Level::kWarning, warning, ""});
  std::stable_sort(out.begin(), out.end(),
                   [](const Remark& a, const Remark& b) { return a.level > b.level; });
  return out;
}

std::vector<std::string> remark_texts(const std::vector<Remark>& remarks) {
  std::vector<std::string> texts;
  for (const Remark& r : remarks) {
    if (r.level == Level::kNote) continue;
    texts.push_back(r.advice.empty() ? r.text : r.text + " " + r.advice);
  }
  return texts;
}

}  // namespace hp2
