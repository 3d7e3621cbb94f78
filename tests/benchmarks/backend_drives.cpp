// hp2_backend_drives: what the back-end makes of whole drives with ground truth. Registers each drive once
// (the submaps are kept in a folder), adds drift if asked for, runs the back-end over the submaps and scores
// every closure.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <random>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <Eigen/SVD>

#include "backend/backend.hpp"
#include "backend/graph/pieces.hpp"
#include "backend/graph/scan_refinement.hpp"
#include "common/error.hpp"
#include "common/evaluation/metrics.hpp"
#include "drive_submaps.hpp"

namespace hp2 {
namespace {

// Where a submap truly is: the pose that lays its scans' poses on the true ones in the mean. Its keypose is
// but one of them, and as wrong as any. A scan beyond a loss of tracking is none of its own.
Pose true_pose(const Submap& whole, const std::vector<StampedPose>& truth) {
  const Submap submap = anchored_submap(whole);
  Eigen::Matrix3d turns = Eigen::Matrix3d::Zero();
  Eigen::Vector3d true_mean = Eigen::Vector3d::Zero(), mean = Eigen::Vector3d::Zero();
  const auto n = static_cast<double>(submap.scans.size());
  for (const ScanPose& s : submap.scans) {
    const Pose& t = truth.at(static_cast<std::size_t>(s.sequence)).pose;
    turns += (t.rotation * s.submap_from_sensor.rotation.conjugate()).toRotationMatrix();
    true_mean += t.translation / n;
    mean += s.submap_from_sensor.translation / n;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(turns, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
  sign(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Quaterniond rotation(Eigen::Matrix3d(svd.matrixU() * sign * svd.matrixV().transpose()));
  return {rotation, true_mean - rotation * mean};
}

// Position error [m] and error of a scan's turn since the scan before [degrees], RMS.
struct Errors {
  double ate_m = 0.0, turn_deg = 0.0;
};
Errors errors_of(const std::vector<StampedPose>& truth, const std::vector<TrajectoryPose>& trajectory,
                 bool corrected) {
  std::vector<Pose> reference, estimate;
  for (const TrajectoryPose& p : trajectory) {
    reference.push_back(truth.at(static_cast<std::size_t>(p.sequence)).pose);
    estimate.push_back(corrected ? p.map_from_sensor : p.odom_from_sensor);
  }
  const Evaluation e = evaluate(make_trajectory(reference), make_trajectory(estimate), Alignment::kSe3);
  return {e.ate.rmse, e.rpe_rotation_deg.rmse};
}

// The scans as closures alone have them, before they are smoothed.
std::vector<TrajectoryPose> unsmoothed(const SessionStore& store, const GraphState& graph) {
  std::vector<TrajectoryPose> out;
  std::vector<Submap> chain;
  for (std::size_t k = 0; k < graph.map_from_submap.size(); ++k) {
    chain.push_back(store.read_submap(static_cast<std::int64_t>(k), false));
    if (k > 0) append_trajectory(chain[k - 1], &chain[k], graph.map_from_submap, out);
  }
  append_trajectory(chain.back(), nullptr, graph.map_from_submap, out);
  return out;
}

// Processor time that `work` takes [ms]: other work on the machine is not ours.
template <class F>
double processor_ms(const F& work) {
  const std::clock_t begin = std::clock();
  work();
  return 1e3 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
}

// The drive's submaps over and over as one long session, to see memory and time grow. Between two laps lies a
// submap of no points that leads back to the start.
int run_laps(const SessionStore& submaps, const std::string& work, int laps, const BackendConfig& config) {
  SessionStore store(work);
  Backend backend(config, store);
  Pose odom_from_submap;
  std::vector<double> ms;
  const std::int64_t n = submaps.submap_count();
  const std::int64_t lap = n + 1, total = lap * laps;
  for (std::int64_t k = 0; k < total; ++k) {
    Submap m;
    if (k % lap < n) {
      m = submaps.read_submap(k % lap);
    } else {
      m.scans.resize(1);
      m.scans[0].submap_from_sensor = odom_from_submap.inverse();
    }
    m.id = k;
    m.odom_from_submap = odom_from_submap;
    for (ScanPose& s : m.scans) s.sequence += 100000 * (k / lap);
    odom_from_submap = odom_from_submap * m.scans.back().submap_from_sensor;
    ms.push_back(processor_ms([&] { backend.add_submap(m, {}, k + 1 == total); }));
    if ((k + 1) % 100 != 0 && k + 1 != total) continue;
    std::vector<double> recent(
        ms.end() - std::min<std::ptrdiff_t>(100, static_cast<std::ptrdiff_t>(ms.size())), ms.end());
    std::sort(recent.begin(), recent.end());
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    const auto& closures = backend.graph().closures;
    std::printf(
        "submaps %5ld scans %6zu closures %5ld  last 100: median %4.0f worst %5.0f ms  peak memory %4ld MB\n",
        static_cast<long>(k + 1), backend.graph().trajectory.size(),
        static_cast<long>(
            std::count_if(closures.begin(), closures.end(), [](const auto& c) { return c.accepted; })),
        recent[recent.size() / 2], recent.back(), usage.ru_maxrss / 1024);
    std::fflush(stdout);
  }
  std::filesystem::remove_all(work);
  return 0;
}

struct Options {
  std::string cache = "out/submaps", poses, mode = "robust";
  double length_m = 0.0, scale = 0.0, yaw = 0.0;
  bool verbose = false;
  int laps = 1;
  Gap gap;
  BackendConfig config;
};

int run(const std::string& drive, const Options& o) {
  const auto source = open_source(drive);
  const auto& truth = source->ground_truth();
  char cached[300];
  std::snprintf(cached, sizeof(cached), "%s/%s_%s_%g", o.cache.c_str(),
                std::filesystem::path(drive).filename().c_str(), o.mode.c_str(), o.length_m);
  std::string name = cached;
  if (o.gap.count > 0) name += "_gap_" + std::to_string(o.gap.first) + "_" + std::to_string(o.gap.count);
  {
    SessionStore store(name);
    if (store.read_meta().count("registered") == 0) {
      register_drive(*source, o.length_m, o.mode, o.gap, store);
      store.write_meta({{"registered", "yes"}});
    }
  }
  const SessionStore submaps(name, SessionStore::Access::kReadOnly);
  const std::string work = name + "_work";
  std::filesystem::remove_all(work);
  if (o.laps > 1) return run_laps(submaps, work, o.laps, o.config);
  SessionStore store(work);
  Backend backend(o.config, store);

  std::vector<double> ms;      // processor time: other work on the machine is not ours
  std::vector<Pose> keyposes;  // true
  Pose odom_from_submap;
  for (std::int64_t id = 0; id < submaps.submap_count(); ++id) {
    Submap m = submaps.read_submap(id);
    keyposes.push_back(true_pose(m, truth));
    m = with_drift(std::move(m), o.scale, o.yaw, odom_from_submap);
    odom_from_submap = odom_from_submap * m.scans.back().submap_from_sensor;
    const bool is_last = id + 1 == submaps.submap_count();
    ms.push_back(processor_ms([&] { backend.add_submap(m, {}, is_last); }));
  }
  const double finish_ms = backend.finish().ms_total;

  const GraphState& graph = backend.graph();
  int accepted = 0, wrong = 0, revisits = 0, closed = 0;
  double worst_m = 0.0, worst_deg = 0.0;
  std::vector<char> has(keyposes.size(), 0);
  for (const ClosureRecord& c : graph.closures) {
    const auto a = static_cast<std::size_t>(c.from_submap), b = static_cast<std::size_t>(c.to_submap);
    const Pose error = (keyposes[a].inverse() * keyposes[b]).inverse() * c.from_from_to;
    const double m = error.translation.norm(), deg = rotation_angle(error.rotation) * 180.0 / M_PI;
    const bool is_false = m > 2.0 || deg > 5.0;
    if (o.verbose) {
      std::printf("    %3ld <- %3ld inliers %2d overlap %5.2f rms %6.3f %s error %.2f m %.2f deg  %s\n",
                  static_cast<long>(c.from_submap), static_cast<long>(c.to_submap), c.inliers, c.overlap,
                  c.residual_m, c.accepted ? (is_false ? "FALSE" : "ok   ") : (is_false ? "-    " : "miss "),
                  m, deg, c.reason.c_str());
    }
    if (!c.accepted) continue;
    ++accepted;
    wrong += is_false;
    worst_m = std::max(worst_m, m);
    worst_deg = std::max(worst_deg, deg);
    has[b] = 1;
  }
  for (std::size_t b = 0; b < keyposes.size(); ++b) {
    bool revisit = false;
    for (std::size_t a = 0; a + 4 <= b; ++a) {
      revisit = revisit || (keyposes[a].translation - keyposes[b].translation).norm() < 20.0;
    }
    revisits += revisit;
    closed += revisit && has[b];
    if (o.verbose && revisit && !has[b])
      std::printf("    submap %zu revisits a place and has no closure\n", b);
  }
  std::sort(ms.begin(), ms.end());
  if (!o.poses.empty()) {
    for (const TrajectoryPose& p : graph.trajectory) {
      FILE* out = std::fopen(o.poses.c_str(), &p == graph.trajectory.data() ? "w" : "a");
      if (!out) break;
      const Pose& t = truth.at(static_cast<std::size_t>(p.sequence)).pose;
      for (const Pose& q : {t, p.odom_from_sensor, p.map_from_sensor}) {
        for (int r = 0; r < 3; ++r) {
          for (int c = 0; c < 4; ++c) std::fprintf(out, "%.9g ", q.matrix()(r, c));
        }
      }
      std::fprintf(out, "%ld\n", static_cast<long>(p.submap));
      std::fclose(out);
    }
  }
  const Errors odometry = errors_of(truth, graph.trajectory, false),
               closures = errors_of(truth, unsmoothed(store, graph), true),
               smoothed = errors_of(truth, graph.trajectory, true);
  std::printf(
      "%-16s submaps %3zu accepted %3d false %d (worst %.2f m %.2f deg) revisits %2d closed %2d "
      "ATE %.3f -> %.3f -> %.3f m turn %.2f -> %.2f -> %.2f deg CPU ms median %.0f worst %.0f finish %.0f\n",
      std::filesystem::path(drive).filename().c_str(), keyposes.size(), accepted, wrong, worst_m, worst_deg,
      revisits, closed, odometry.ate_m, closures.ate_m, smoothed.ate_m, odometry.turn_deg, closures.turn_deg,
      smoothed.turn_deg, ms[ms.size() / 2], ms.back(), finish_ms);
  std::fflush(stdout);
  std::filesystem::remove_all(work);
  return wrong;
}

}  // namespace
}  // namespace hp2

int main(int argc, char** argv) {
  CLI::App app(
      "Scores the back-end on drives with ground truth; exits with 1 if a false closure was accepted.");
  std::vector<std::string> drives;
  hp2::Options o;
  app.add_option("drives", drives, "drives, as on every command line")->required();
  app.add_option("--cache", o.cache, "folder to keep the registered submaps in");
  app.add_option("--poses", o.poses,
                 "file to write every scan's poses to: true, odometry's, final (3x4 each), submap");
  app.add_option("--max-drift", o.config.max_drift, "drift that a closure is believed at, share of the path");
  app.add_option("--mode", o.mode, "front-end's mode");
  app.add_option("--length", o.length_m, "submap length [m]; 0: the front-end's own choice");
  app.add_option("--drift-scale", o.scale, "added drift along the path, share of the path");
  app.add_option("--drift-yaw", o.yaw, "added drift of the heading [rad/m]");
  app.add_option("--graph-candidates", o.config.graph_candidates,
                 "pairs that the corrected graph says overlap");
  app.add_option("--candidates", o.config.candidates, "adaptive or paper");
  app.add_option("--gap", o.gap.first, "first of the scans that are left out (see --gap-count)");
  app.add_option("--gap-count", o.gap.count, "scans left out");
  app.add_option("--laps", o.laps, "drive the drive's submaps so often, for memory and time only");
  app.add_flag("--verbose", o.verbose, "every verdict");
  CLI11_PARSE(app, argc, argv);
  int wrong = 0;
  try {
    for (const auto& d : drives) wrong += hp2::run(d, o);
  } catch (const hp2::Error& e) {
    std::fprintf(stderr, "%s\n", e.what());
    return 2;
  }
  return wrong > 0;
}
