// Google Benchmark of the front-end's stages and kernels: how their time grows with the points per scan, the
// range and the size of the map. The stages are timed inside the whole front-end, by its own clock, because
// what a stage costs depends on what the ones before it left.
#include <algorithm>
#include <cmath>
#include <map>

#include <benchmark/benchmark.h>

#include "common/registration/hybrid_icp.hpp"
#include "common/registration/local_map.hpp"
#include "frontend/frontend.hpp"
#include "frontend/odometry/preprocess.hpp"
#include "player/synthetic/build_world.hpp"

namespace hp2 {
namespace {

constexpr double kSpeed_m = 1.0;  ///< Travel a scan [m].
constexpr int kWarmUp = 6;        ///< Scans before the timed ones.
constexpr int kScans = 18;

/// Streets of 600 x 600 m.
const World& town() {
  static const World world = [] {
    std::vector<double> streets;
    for (int k = -6; k <= 6; ++k) streets.push_back(50.0 * k);
    return build_town(3, streets, streets);
  }();
  return world;
}

Pose map_from_sensor(int scan) {
  return {Eigen::Quaterniond::Identity(), {kSpeed_m * scan - 40.0, 0.0, 1.8}};
}

/// A sweep of a spinning sensor with 64 beams that stands still during the sweep, and about n returns.
Scan sweep(int index, int n, double max_range_m) {
  constexpr int kBeams = 64;
  const Pose pose = map_from_sensor(index);
  Scan scan;
  scan.sequence = index;
  scan.utime = 100'000 * index;
  const auto fire = [&](int columns) {
    for (auto* v : {&scan.x, &scan.y, &scan.z}) v->clear();
    for (int c = 0; c < columns; ++c) {
      const double azimuth = M_PI * (1.0 - 2.0 * c / columns);
      for (int b = 0; b < kBeams; ++b) {
        const double elevation = (-25.0 + 40.0 * b / (kBeams - 1)) * M_PI / 180.0;
        const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                  std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
        const Hit hit = town().cast(pose.translation, ray, max_range_m);
        if (hit.range < 0.0) continue;
        const Eigen::Vector3f p = (hit.range * ray).cast<float>();
        scan.x.push_back(p.x()), scan.y.push_back(p.y()), scan.z.push_back(p.z());
      }
    }
  };
  fire(200);  // how many rays find something
  fire(static_cast<int>(200.0 * n / std::max<double>(1.0, static_cast<double>(scan.size()))));
  return scan;
}

/// The sweeps of one drive, made once.
const std::vector<Scan>& drive(int points, double max_range_m) {
  static std::map<std::pair<int, int>, std::vector<Scan>> made;
  auto& scans = made[{points, static_cast<int>(max_range_m)}];
  for (int i = static_cast<int>(scans.size()); i < kScans; ++i)
    scans.push_back(sweep(i, points, max_range_m));
  return scans;
}

// ---------------------------------------------------------------- the whole front-end

/// Registers the drive again and again; times the scans after the warm-up by the front-end's own clock.
void run_front_end(benchmark::State& state, int points, double max_range_m, int threads) {
  const auto& scans = drive(points, max_range_m);
  FrontendConfig config;
  config.max_range_m = max_range_m;
  Frontend frontend(config, threads);
  std::size_t next = 0;
  std::array<double, 6> sums{};
  for (auto _ : state) {
    if (next == 0 || next == scans.size()) {
      frontend = Frontend(config, threads);
      for (next = 0; next < kWarmUp; ++next) frontend.process(scans[next]);
    }
    const auto ms = frontend.process(scans[next++]).odometry.diagnostics.ms;
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += ms[k];
    state.SetIterationTime(1e-3 * ms[5]);
  }
  static const char* const kNames[] = {"preprocess_ms", "search_ms", "planarity_ms", "solve_ms", "map_ms"};
  for (std::size_t k = 0; k < 5; ++k)
    state.counters[kNames[k]] = benchmark::Counter(sums[k], benchmark::Counter::kAvgIterations);
  state.counters["points"] = static_cast<double>(scans.back().size());
}

void BM_ScanOverPoints(benchmark::State& state) {
  run_front_end(state, static_cast<int>(state.range(0)), 100.0, static_cast<int>(state.range(1)));
}
void BM_ScanOverRange(benchmark::State& state) {
  run_front_end(state, 60'000, static_cast<double>(state.range(0)), 2);
}
BENCHMARK(BM_ScanOverPoints)
    ->ArgNames({"points", "threads"})
    ->ArgsProduct({{10'000, 20'000, 40'000, 80'000, 120'000, 180'000, 250'000}, {1, 2}})
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(BM_ScanOverRange)
    ->ArgName("range_m")
    ->Arg(10)
    ->Arg(20)
    ->Arg(40)
    ->Arg(80)
    ->Arg(120)
    ->Arg(200)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

// ---------------------------------------------------------------- kernels

std::vector<Eigen::Vector3f> downsampled(const Scan& scan, bool source) {
  const FrontendConfig c;
  Preprocessor preprocessor({c.min_range_m, c.max_range_m});
  PreprocessedScan out;
  preprocessor.run(scan, false, Parallel(1), out);
  if (!source) return out.points;
  std::vector<Eigen::Vector3f> points;
  for (const auto i : out.source) points.push_back(out.points[i]);
  return points;
}

void BM_Preprocess(benchmark::State& state) {
  const FrontendConfig c;
  const Scan& scan = drive(static_cast<int>(state.range(0)), 100.0).front();
  Preprocessor preprocessor({c.min_range_m, c.max_range_m});
  const Parallel parallel(static_cast<int>(state.range(1)));
  PreprocessedScan out;
  for (auto _ : state) preprocessor.run(scan, false, parallel, out);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(scan.size()));
  state.counters["kept"] = static_cast<double>(out.points.size());
}
BENCHMARK(BM_Preprocess)
    ->ArgNames({"points", "threads"})
    ->ArgsProduct({{10'000, 40'000, 120'000, 250'000}, {1, 2}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

/// A map of the points that so many scans along the street leave in it, and nothing dropped.
LocalMap make_map(std::int64_t scans) {
  const FrontendConfig c;
  LocalMap map(MapSizes().voxel_m, c.max_points_per_voxel, MapSizes().spacing_m);
  // Scans further apart than a drive's: the map grows by what each sees anew.
  for (std::int64_t i = 0; i < scans; ++i) {
    const int at = static_cast<int>(5 * i);
    map.insert(downsampled(sweep(at, 30'000, 100.0), false), map_from_sensor(at));
  }
  return map;
}

LocalMap& map_of(std::int64_t scans) {
  static std::map<std::int64_t, LocalMap> made;
  const auto it = made.find(scans);
  return it != made.end() ? it->second : made.emplace(scans, make_map(scans)).first->second;
}

void BM_NearestNeighbour(benchmark::State& state) {
  const LocalMap& map = map_of(state.range(0));
  const auto points = downsampled(drive(30'000, 100.0).front(), true);
  const Pose pose = map_from_sensor(0) * Pose(so3_exp({0, 0, 0.002}), {0.05, -0.03, 0.02});
  std::size_t found = 0, asked = 0;
  for (auto _ : state) {
    for (const auto& p : points)
      found += map.nearest(map.locate(pose * p.cast<double>())).voxel >= 0 ? 1U : 0U;
    asked += points.size();
  }
  state.SetItemsProcessed(static_cast<std::int64_t>(asked));
  state.counters["map_points"] = static_cast<double>(map.point_count());
  state.counters["found"] = static_cast<double>(found) / static_cast<double>(std::max<std::size_t>(asked, 1));
}
BENCHMARK(BM_NearestNeighbour)
    ->ArgName("scans_in_map")
    ->Arg(1)
    ->Arg(5)
    ->Arg(20)
    ->Arg(80)
    ->Unit(benchmark::kMicrosecond);

void BM_Planarity(benchmark::State& state) {
  LocalMap& map = map_of(state.range(0));
  std::vector<std::int32_t> voxels;
  for (const auto& p : downsampled(drive(30'000, 100.0).front(), true)) {
    const auto near = map.nearest(map.locate(map_from_sensor(0) * p.cast<double>()));
    if (near.voxel >= 0) voxels.push_back(near.voxel);
  }
  for (auto _ : state)
    for (const auto v : voxels) map.update_planarity(v);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(voxels.size()));
  state.counters["map_points"] = static_cast<double>(map.point_count());
}
BENCHMARK(BM_Planarity)->ArgName("scans_in_map")->Arg(1)->Arg(20)->Unit(benchmark::kMicrosecond);

void BM_Align(benchmark::State& state) {
  LocalMap& map = map_of(20);
  const auto points = downsampled(drive(static_cast<int>(state.range(0)), 100.0)[3], true);
  const Pose truth = map_from_sensor(3);
  const Pose guess = truth * Pose(so3_exp({0.001, -0.001, 0.005}), {0.15, -0.05, 0.02});
  HybridIcp icp(icp_config(FrontendConfig{}));
  const Parallel parallel(static_cast<int>(state.range(1)));
  IcpResult result;
  for (auto _ : state) result = icp.align(map, points, guess, 0.3, parallel);
  state.counters["source"] = static_cast<double>(points.size());
  state.counters["iterations"] = result.iterations;
  state.counters["error_mm"] = 1e3 * (result.map_from_source.translation - truth.translation).norm();
}
BENCHMARK(BM_Align)
    ->ArgNames({"points", "threads"})
    ->ArgsProduct({{10'000, 40'000, 120'000, 250'000}, {1, 2}})
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

void BM_MapUpdate(benchmark::State& state) {
  const FrontendConfig c;
  const auto points = downsampled(drive(60'000, 100.0).front(), false);
  LocalMap map = make_map(state.range(0));
  int at = 0;
  for (auto _ : state) {  // drives on, and what is left behind is dropped
    const Pose pose = map_from_sensor(++at);
    map.insert(points, pose);
    map.remove_far(pose.translation, c.max_range_m);
  }
  state.counters["inserted"] = static_cast<double>(points.size());
  state.counters["map_points"] = static_cast<double>(map.point_count());
}
BENCHMARK(BM_MapUpdate)->ArgName("scans_in_map")->Arg(1)->Arg(20)->Arg(80)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace hp2

BENCHMARK_MAIN();
