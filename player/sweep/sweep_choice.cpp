#include "player/sweep/sweep_choice.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>

#include "common/registration/parallel.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kUnsettledScans = 2;  // the map holds too little yet
constexpr double kLeastStep_m = 0.2;        // per scan, in a scene of scale 1
constexpr std::size_t kLeastScans = 10;
constexpr int kThreads = 2;

double mean(const std::vector<double>& v) {
  return std::accumulate(v.begin(), v.end(), 0.0) / static_cast<double>(std::max<std::size_t>(v.size(), 1));
}

void append(const TrialResult& result, std::vector<double>& costs) {
  const std::vector<double> more = settled_costs(result);
  costs.insert(costs.end(), more.begin(), more.end());
}

bool distorts(const SweepReading& r) { return r.kind != SweepReading::Kind::kCompensated; }

}  // namespace

std::vector<double> settled_costs(const TrialResult& result) {
  const std::size_t unsettled = std::min(result.costs.size(), kUnsettledScans);
  return {result.costs.begin() + static_cast<std::ptrdiff_t>(unsettled), result.costs.end()};
}

// Neighbouring scans see the same things, so their differences are alike: they count as fewer.
CostDifference compare_costs(const std::vector<double>& worse, const std::vector<double>& better) {
  const std::size_t n = std::min(worse.size(), better.size());
  if (n < kLeastScans - kUnsettledScans) return {};
  std::vector<double> d(n);
  for (std::size_t i = 0; i < n; ++i) d[i] = worse[i] - better[i];
  const double m = mean(d);
  double squares = 1e-12, neighbours = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    squares += (d[i] - m) * (d[i] - m);
    if (i > 0) neighbours += (d[i] - m) * (d[i - 1] - m);
  }
  const double correlation = std::clamp(neighbours / squares, 0.0, 0.8);
  const double count = static_cast<double>(n) * (1.0 - correlation) / (1.0 + correlation);
  return {m, m / std::sqrt(squares / static_cast<double>(n - 1) / std::max(count, 1.0))};
}

SweepComparison::SweepComparison(const std::vector<SweepReading>& readings, double sweep_s, double scale)
    : sweep_s_(sweep_s), scale_(scale) {
  for (const SweepReading& r : readings) candidates_.push_back({r, {}, {}, false});
}

bool SweepComparison::add_stretch(const std::vector<TrialScan>& scans) {
  if (scans.size() < kLeastScans) return false;
  const SweepReading still;
  const TrialResult first = try_reading(scans, still, 0.0, sweep_s_, scale_, nullptr);
  if (first.travelled_m < kLeastStep_m * scale_ * static_cast<double>(scans.size())) return false;

  // Each reading with all of the motion undone and with half of it; what is undistorted, once.
  struct Job {
    Candidate* candidate;
    double gain;
    TrialResult result;
  };
  std::vector<Job> jobs{{nullptr, 0.0, {}}};
  for (Candidate& c : candidates_)
    if (!c.dropped && distorts(c.reading)) jobs.push_back({&c, 1.0, {}});
  const auto run = [&](std::vector<Job>& all) {
    Parallel(kThreads).for_blocks(all.size(), 1, [&](std::size_t j, std::size_t, std::size_t) {
      Job& job = all[j];
      job.result = try_reading(scans, job.candidate != nullptr ? job.candidate->reading : still, job.gain,
                               sweep_s_, scale_, &first);
    });
  };
  run(jobs);
  for (Candidate& c : candidates_)
    if (!distorts(c.reading)) append(jobs.front().result, c.costs);
  append(jobs.front().result, undistorted_costs_);
  for (const Job& job : jobs)
    if (job.candidate != nullptr) append(job.result, job.candidate->costs);
  scans_ += scans.size();

  Candidate& best = candidates_[best_candidate()];
  if (distorts(best.reading)) {
    std::vector<Job> half{{&best, 0.5, {}}};
    run(half);
    append(half.front().result, best.half_costs);
  }
  for (Candidate& c : candidates_)
    if (&c != &best && !c.dropped && compare_costs(c.costs, best.costs).deviations > 6.0) c.dropped = true;
  return true;
}

std::size_t SweepComparison::best_candidate() const {
  std::size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    if (candidates_[i].dropped || candidates_[i].costs.empty()) continue;
    if (mean(candidates_[i].costs) >= least) continue;
    least = mean(candidates_[i].costs);
    best = i;
  }
  return best;
}

// Were the reading right in part only, the scans would agree best with another share of the motion undone.
bool SweepComparison::motion_fits(const Candidate& best) const {
  if (best.half_costs.size() != best.costs.size()) return false;
  const double none = mean(undistorted_costs_), half = mean(best.half_costs), all = mean(best.costs);
  const double curvature = none - 2.0 * half + all;
  if (curvature <= 0.0) return all < half;
  const double optimum = 0.5 + 0.25 * (none - all) / curvature;
  return optimum > 0.6 && optimum < 2.0;
}

std::optional<SweepReading> SweepComparison::best(const Demand& demand) const {
  if (scans_ == 0) return std::nullopt;
  const Candidate& best = candidates_[best_candidate()];
  if (distorts(best.reading) && !motion_fits(best)) return std::nullopt;
  for (const Candidate& c : candidates_) {
    if (&c == &best || c.dropped) continue;
    const CostDifference d = compare_costs(c.costs, best.costs);
    if (d.deviations < demand.deviations || d.mean < demand.share * mean(best.costs)) return std::nullopt;
  }
  return best.reading;
}

std::string SweepComparison::to_text() const {
  std::string text;
  if (scans_ == 0) return text;
  const Candidate& best = candidates_[best_candidate()];
  for (const Candidate& c : candidates_) {
    const CostDifference d = compare_costs(c.costs, best.costs);
    text += fmt::format("{}{}: cost {:.4f}, {:+.4f} ({:.1f} deviations{})", text.empty() ? "" : "; ",
                        hp2::to_text(c.reading), mean(c.costs), d.mean, d.deviations,
                        c.dropped ? ", dropped" : "");
  }
  if (!best.half_costs.empty())
    text += fmt::format("; undone by half {:.4f}, not at all {:.4f}", mean(best.half_costs),
                        mean(undistorted_costs_));
  return text;
}

}  // namespace hp2
