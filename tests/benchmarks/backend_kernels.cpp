// Google Benchmark of the back-end's kernels whose time grows with the session: the Hamming trees up to a
// million descriptors, and the pose graph of 10,000 submaps after a new closure.
#include <cmath>
#include <map>
#include <random>
#include <set>

#include <benchmark/benchmark.h>

#include "backend/graph/pose_graph.hpp"
#include "backend/places/hamming_tree.hpp"

namespace hp2 {
namespace {

constexpr int kFlippedBits = 25, kMatchBits = 50;

struct Million {
  std::vector<TreeEntry> entries;
  HammingTree tree;
  std::vector<std::size_t> truth;
  std::vector<Descriptor> queries;
};

// n random descriptors, and queries that are one of them with 25 of 256 bits flipped.
Million& descriptors(std::int64_t n) {
  static std::map<std::int64_t, Million> made;
  Million& m = made[n];
  if (!m.entries.empty()) return m;
  std::mt19937_64 rng(7);
  for (std::int64_t i = 0; i < n; ++i) {
    m.entries.push_back({{rng(), rng(), rng(), rng()},
                         static_cast<std::int32_t>(i / 500),
                         static_cast<std::int32_t>(i % 500)});
    m.tree.insert(m.entries.back());
  }
  for (int q = 0; q < 2000; ++q) {
    m.truth.push_back(rng() % m.entries.size());
    Descriptor d = m.entries[m.truth.back()].descriptor;
    std::set<std::size_t> bits;
    while (bits.size() < kFlippedBits) bits.insert(rng() % 256);
    for (const std::size_t b : bits) d[b >> 6] ^= std::uint64_t{1} << (b & 63);
    m.queries.push_back(d);
  }
  return m;
}

void BM_TreeSearch(benchmark::State& state) {
  Million& m = descriptors(state.range(0));
  std::vector<TreeMatch> matches;
  std::size_t q = 0, found = 0, asked = 0;
  for (auto _ : state) {
    m.tree.search(m.queries[q], kMatchBits, matches);
    const TreeEntry& truth = m.entries[m.truth[q]];
    for (const auto& match : matches) found += match.submap == truth.submap && match.feature == truth.feature;
    ++asked;
    q = (q + 1) % m.queries.size();
  }
  state.counters["recall"] = static_cast<double>(found) / static_cast<double>(asked);
  state.counters["MB"] = static_cast<double>(m.tree.memory()) / 1e6;
}
BENCHMARK(BM_TreeSearch)->Arg(10000)->Arg(100000)->Arg(1000000)->Unit(benchmark::kMicrosecond);

HP2_COUNTS_BITS int scan_all(const TreeEntry* e, std::size_t n, const Descriptor& q) {
  int found = 0;
  for (std::size_t i = 0; i < n; ++i) {
    found += __builtin_popcountll(e[i].descriptor[0] ^ q[0]) +
                 __builtin_popcountll(e[i].descriptor[1] ^ q[1]) +
                 __builtin_popcountll(e[i].descriptor[2] ^ q[2]) +
                 __builtin_popcountll(e[i].descriptor[3] ^ q[3]) <=
             kMatchBits;
  }
  return found;
}

void BM_BruteForce(benchmark::State& state) {
  Million& m = descriptors(state.range(0));
  std::size_t q = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(scan_all(m.entries.data(), m.entries.size(), m.queries[q]));
    q = (q + 1) % m.queries.size();
  }
}
BENCHMARK(BM_BruteForce)->Arg(10000)->Arg(100000)->Arg(1000000)->Unit(benchmark::kMicrosecond);

void BM_TreeInsert(benchmark::State& state) {
  std::mt19937_64 rng(9);
  HammingTree tree;
  std::int32_t i = 0;
  for (auto _ : state) tree.insert({{rng(), rng(), rng(), rng()}, i++, 0});
}
BENCHMARK(BM_TreeInsert)->Iterations(1000000)->Unit(benchmark::kMicrosecond);

// A drive round and round a city: closures between laps, the newest of them just found.
void BM_PoseGraph(benchmark::State& state) {
  const auto n = static_cast<std::size_t>(state.range(0));
  const std::size_t lap = n / 20, n_closures = n / 10;
  std::mt19937 rng(1);
  std::normal_distribution<double> normal;
  const auto noise = [&](double t, double r) {
    Vector6d x;
    for (int i = 0; i < 6; ++i) x[i] = normal(rng) * (i < 3 ? t : r);
    return se3_exp(x);
  };
  const auto information = [](double t, double r) {
    Vector6d d;
    d << 1 / (t * t), 1 / (t * t), 1 / (t * t), 1 / (r * r), 1 / (r * r), 1 / (r * r);
    return Matrix6d(d.asDiagonal());
  };
  std::vector<Pose> truth;
  for (std::size_t i = 0; i < n; ++i) {
    const double a = 2.0 * M_PI * static_cast<double>(i) / static_cast<double>(lap);
    const double r = 25.0 * static_cast<double>(lap) / (2.0 * M_PI);
    truth.emplace_back(so3_exp({0, 0, a + M_PI / 2}),
                       Eigen::Vector3d(r * std::cos(a), r * std::sin(a), 3.0 * std::sin(5 * a)));
  }
  std::vector<GraphEdge> odometry, closures;
  std::vector<Pose> nodes{truth[0]};
  for (std::size_t i = 0; i + 1 < n; ++i) {
    odometry.push_back(
        {i, i + 1, truth[i].inverse() * truth[i + 1] * noise(0.02, 5e-4), information(0.02, 5e-4)});
    nodes.push_back(nodes.back() * odometry.back().from_from_to);
  }
  for (std::size_t k = 0; k < n_closures; ++k) {
    const std::size_t to = k + 1 == n_closures ? n - 1 : lap + (k * 997) % (n - lap - 1);
    closures.push_back(
        {to - lap, to, truth[to - lap].inverse() * truth[to] * noise(0.05, 2e-3), information(0.05, 2e-3)});
  }
  // As it stands before the newest closure comes: optimised with all the others.
  optimise_consistent(nodes, odometry, {closures.begin(), closures.end() - 1});
  for (auto _ : state) {
    auto warm = nodes;
    benchmark::DoNotOptimize(optimise_consistent(warm, odometry, closures));
  }
}
BENCHMARK(BM_PoseGraph)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace hp2

BENCHMARK_MAIN();
