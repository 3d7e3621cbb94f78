#include "player/sweep/stamp_mender.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>

#include <fmt/format.h>

#include "common/time_unit.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kLookahead = 5;   // scans that bear witness for or against a stamp
constexpr std::size_t kLatest = 20;     // a scan comes late by so many scans at most
constexpr std::size_t kLongestEnd = 3;  // stamps at an end that may all be wrong
constexpr double kFarEnd_s = 60.0;
constexpr double kJump_s = 10.0;
constexpr double kMostTime_s = 4e12;  // half of what 64 bits of microseconds hold: differences must fit, too

double median(std::vector<double> v) {
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

bool is_time(double t) { return std::isfinite(t) && std::abs(t) <= kMostTime_s; }

/// Steps between neighbours in `v` that have a time, per place.
std::vector<double> steps_of(const std::vector<double>& v) {
  std::vector<double> steps;
  std::size_t before = v.size();
  for (std::size_t i = 0; i < v.size(); ++i) {
    if (!std::isfinite(v[i])) continue;
    if (before < v.size()) steps.push_back((v[i] - v[before]) / static_cast<double>(i - before));
    before = i;
  }
  return steps;
}

std::vector<double> rising(std::vector<double> steps) {
  steps.erase(std::remove_if(steps.begin(), steps.end(), [](double s) { return !(s > 0.0); }), steps.end());
  return steps;
}

/// Counts scans and remembers the first few of them for a sentence.
struct Tally {
  std::size_t count = 0;
  std::string first;
  void add(std::size_t scan) {
    if (count < 3) first += (first.empty() ? "" : ", ") + std::to_string(scan);
    ++count;
  }
  /// "1 scan (scan 7)", "5 scans (scans 7, 8, 9, ...)"
  std::string text(const char* noun) const {
    return fmt::format("{} {}{} (scan{} {}{})", count, noun, count == 1 ? "" : "s", count == 1 ? "" : "s",
                       first, count > 3 ? ", ..." : "");
  }
};

std::string length_of(double seconds) {
  const double s = std::abs(seconds);
  if (s < 120.0) return fmt::format("{:.3g} s", s);
  if (s < 7200.0) return fmt::format("{:.1f} minutes", s / 60.0);
  if (s < 2 * 86400.0) return fmt::format("{:.1f} hours", s / 3600.0);
  if (s < 2 * 31557600.0) return fmt::format("{:.1f} days", s / 86400.0);
  return fmt::format("{:.1f} years", s / 31557600.0);
}

/// A scan in the order of time.
struct Placed {
  std::size_t scan = 0;
  double t = 0.0;      ///< [s]
  bool known = false;  ///< false: t is to be made from the neighbours'.
};

class Mender {
 public:
  Mender(const std::vector<double>& times_s, std::string what, const MendOptions& options)
      : times_(times_s), what_(std::move(what)), options_(options) {
    for (double& t : times_)
      if (!is_time(t)) t = std::numeric_limits<double>::quiet_NaN();
  }

  MendedStamps run() {
    drop_copies();
    if (!find_step()) return evenly();
    for (std::size_t k = 0; k < scans_.size(); ++k) place(k);
    doubt_ends();
    fill();
    report();
    return result();
  }

 private:
  /// Copies of a scan are recognised by their points; asked are scans of the same stamp, and neighbours that
  /// are much nearer than others.
  void drop_copies() {
    std::map<double, std::size_t> seen;
    std::size_t before = times_.size();
    for (std::size_t i = 0; i < times_.size(); ++i) {
      bool copy = false;
      if (options_.same_points && std::isfinite(times_[i])) {
        const auto [at, is_new] = seen.emplace(times_[i], i);
        copy = !is_new && options_.same_points(at->second, i);
        if (!copy && before < i) {
          const double step = std::abs(times_[i] - times_[before]);
          const double next = i + 1 < times_.size() ? times_[i + 1] - times_[i] : 0.0;
          const double last = before > 0 ? times_[before] - times_[before - 1] : 0.0;
          if (step > 0.0 && 4.0 * step < std::max(next, last)) copy = options_.same_points(before, i);
        }
      }
      if (copy) {
        copies_.add(i);
        continue;
      }
      scans_.push_back(i);
      if (std::isfinite(times_[i])) before = i;
    }
  }

  std::vector<double> kept_times() const {
    std::vector<double> kept;
    for (const std::size_t i : scans_) kept.push_back(times_[i]);
    return kept;
  }

  /// The usual step; false if the stamps are of no use.
  bool find_step() {
    std::vector<double> steps = steps_of(kept_times());
    std::vector<double> up = rising(steps);
    if (up.empty()) return false;
    if (2 * up.size() < steps.size()) {
      if (!options_.may_reorder || !sort_all()) return false;
      steps = steps_of(kept_times());
      up = rising(steps);
    }
    step_ = median(up);
    return step_ > 1e-6;
  }

  /// Scans in no order at all, as files named by something else: stamps that are all different sort them.
  bool sort_all() {
    const auto before = [this](std::size_t a, std::size_t b) {
      return !std::isnan(times_[a]) && (std::isnan(times_[b]) || times_[a] < times_[b]);
    };
    std::vector<std::size_t> sorted = scans_;
    std::stable_sort(sorted.begin(), sorted.end(), before);
    for (std::size_t i = 1; i < sorted.size(); ++i)
      if (times_[sorted[i]] == times_[sorted[i - 1]]) return false;
    for (std::size_t i = 0; i < sorted.size(); ++i)
      if (sorted[i] != scans_[i]) late_.add(scans_[i]);
    scans_ = sorted;
    return true;
  }

  /// Stamps of the next scans that have one.
  std::vector<double> witnesses(std::size_t k) const {
    std::vector<double> next;
    for (std::size_t i = k + 1; i < scans_.size() && next.size() < kLookahead; ++i)
      if (std::isfinite(times_[scans_[i]])) next.push_back(times_[scans_[i]] + shift_);
    return next;
  }

  /// Whether a stamp that lies further ahead than usual contradicts those that come after it.
  bool is_too_late(double t, double last, const std::vector<double>& next) const {
    if (t - last <= 1.5 * step_ || next.empty()) return false;
    double nearest = std::abs(next[0] - t);
    std::size_t below = 0;
    for (const double n : next) {
      nearest = std::min(nearest, std::abs(n - t));
      below += n < t ? 1 : 0;
    }
    // The next scan's stamp; of the two, the one beside the empty place is wrong.
    if (std::abs(next[0] - t) < 0.25 * step_)
      return std::isfinite(last) || (next.size() > 1 && next[1] - t < 1.5 * step_);
    if (below == 0) return false;
    if (nearest < 0.55 * step_) return true;  // scans that came in another order keep their distance
    if (below == kLookahead) return true;     // nor does a scan come before so many others
    return 2 * below > next.size() && (t - *std::max_element(next.begin(), next.end()) > 1.5 * step_ ||
                                       t - median(next) > std::max(1.0, 5.0 * step_));
  }

  /// Whether those that come after a stamp that fell go on from it, and not from the one before.
  bool steps_back(double t, const std::vector<double>& next) const {
    if (next.empty() || last_ - t < 0.5 * step_) return false;
    std::vector<double> from_here, from_before;
    for (std::size_t k = 0; k < next.size(); ++k) {
      const double steps = static_cast<double>(k + 1) * step_;
      from_here.push_back(std::abs(next[k] - t - steps));
      from_before.push_back(std::abs(next[k] - last_ - step_ - steps));
    }
    return median(from_here) < median(from_before);
  }

  /// The gap that a late scan fits: before this place in the order; nothing if there is none.
  std::optional<std::size_t> gap_for(double t) const {
    double after = std::numeric_limits<double>::infinity();
    std::size_t looked = 0;
    for (std::size_t p = order_.size(); p > 0 && looked < kLatest; --p) {
      const Placed& here = order_[p - 1];
      if (!here.known) continue;
      ++looked;
      if (here.t < t) {
        const bool fits =
            after - here.t >= 1.5 * step_ && t - here.t >= 0.25 * step_ && after - t >= 0.25 * step_;
        return fits && std::isfinite(after) ? std::optional<std::size_t>(p) : std::nullopt;
      }
      after = here.t;
      if (p == 1 && after - t <= 1.5 * step_ && after - t >= 0.25 * step_) return 0;  // before all others
    }
    return std::nullopt;
  }

  void place(std::size_t k) {
    const std::size_t scan = scans_[k];
    if (!std::isfinite(times_[scan])) return order_.push_back({scan, 0.0, false});
    const double t = times_[scan] + shift_;
    const std::vector<double> next = witnesses(k);
    if (last_ < t) {
      const bool wrong = is_too_late(t, last_, next);
      order_.push_back({scan, t, !wrong});
      if (!wrong) last_ = t;
      return;
    }
    if (const auto gap = gap_for(t); gap && options_.may_reorder) {
      order_.insert(order_.begin() + static_cast<std::ptrdiff_t>(*gap), Placed{scan, t, true});
      late_.add(scan);
      return;
    }
    if (!steps_back(t, next)) return order_.push_back({scan, 0.0, false});
    back_.add(scan);
    furthest_back_ = std::max(furthest_back_, last_ - t);
    shift_ += last_ + step_ - t;
    last_ += step_;
    order_.push_back({scan, last_, true});
  }

  /// A few stamps at an end, far from all others: those of a clock that was not set yet.
  void doubt_ends() {
    std::vector<std::size_t> known;
    for (std::size_t p = 0; p < order_.size(); ++p)
      if (order_[p].known) known.push_back(p);
    const std::size_t n = known.size();
    const double far = std::max(kFarEnd_s, 100.0 * step_);
    for (std::size_t k = std::min(kLongestEnd, n / 4); k > 0; --k)
      if (order_[known[k]].t - order_[known[k - 1]].t > far) {
        for (std::size_t i = 0; i < k; ++i) order_[known[i]].known = false;
        break;
      }
    for (std::size_t k = std::min(kLongestEnd, n / 4); k > 0; --k)
      if (order_[known[n - k]].t - order_[known[n - k - 1]].t > far) {
        for (std::size_t i = n - k; i < n; ++i) order_[known[i]].known = false;
        break;
      }
  }

  /// Makes the stamps that are not known from their neighbours'.
  void fill() {
    for (std::size_t p = 0; p < order_.size();) {
      if (order_[p].known) {
        ++p;
        continue;
      }
      std::size_t end = p;
      while (end < order_.size() && !order_[end].known) ++end;
      const auto room = static_cast<double>(end - p + 1);
      double step = step_;
      if (p > 0 && end < order_.size())
        step = std::min((order_[end].t - order_[p - 1].t) / room, 1.5 * step_);
      for (std::size_t i = p; i < end; ++i) {
        const auto k = static_cast<double>(i - p + 1);
        order_[i].t = p > 0 ? order_[p - 1].t + k * step : order_[end].t - (room - k) * step;
        (std::isfinite(times_[order_[i].scan]) ? wrong_ : missing_).add(order_[i].scan);
      }
      p = end;
    }
    for (std::size_t p = 1; p < order_.size(); ++p)
      if (order_[p].t - order_[p - 1].t > std::max(kJump_s, 20.0 * step_)) {
        jumps_.add(order_[p].scan);
        longest_jump_ = std::max(longest_jump_, order_[p].t - order_[p - 1].t);
      }
  }

  void say(const std::string& text) { warnings_.push_back(what_ + ": " + text); }

  void report() {
    if (missing_.count > 0)
      say(missing_.text("scan") + " without a time: its stamp is made from its neighbours'");
    if (wrong_.count > 0)
      say(wrong_.text("stamp") + " contradict" + (wrong_.count == 1 ? "s" : "") +
          " the neighbours': replaced by one between theirs");
    if (late_.count > 0) say(late_.text("scan") + " out of order: sorted by stamp");
    if (back_.count > 0)
      say(fmt::format(
          "the clock steps back {} (by {} at most): the stamps that follow are shifted so that time goes on",
          back_.text("time"), length_of(furthest_back_)));
    if (jumps_.count > 0)
      say(fmt::format("the stamps jump ahead {} (by {} at most): the stamps stay, the gap is not waited for",
                      jumps_.text("time"), length_of(longest_jump_)));
    report_copies();
  }

  void report_copies() {
    if (copies_.count > 0) say(copies_.text("scan") + " with the same stamp and points as another: left out");
  }

  MendedStamps result() {
    MendedStamps mended;
    for (const Placed& p : order_) {
      const auto stamp = static_cast<std::int64_t>(std::llround(p.t * 1e6));
      mended.order.push_back(p.scan);
      mended.stamps_us.push_back(mended.stamps_us.empty() ? stamp
                                                          : std::max(stamp, mended.stamps_us.back() + 1));
    }
    mended.warnings = std::move(warnings_);
    return mended;
  }

  /// For stamps of no use: evenly between first and last if that is plausible (stamps of few digits), else 10
  /// Hz.
  MendedStamps evenly() {
    const std::vector<double> kept = kept_times();
    const auto n = static_cast<double>(kept.size());
    std::size_t different = 0;
    for (std::size_t i = 0; i < kept.size(); ++i)
      different += std::isfinite(kept[i]) && (i == 0 || kept[i] != kept[i - 1]) ? 1 : 0;
    double step = 1e-6 * static_cast<double>(kAssumedSweep_us);
    double begin = 0.0;
    const double mean = kept.size() > 1 ? (kept.back() - kept.front()) / (n - 1.0) : 0.0;
    if (kept.size() == 1 && different == 1) {
      begin = kept.front();
    } else if (different > 2 && mean >= kShortestStep_s && mean <= kLongestStep_s &&
               std::is_sorted(kept.begin(), kept.end())) {
      step = mean;
      begin = kept.front();
      say(fmt::format(
          "only {} different times for {} scans: the scans are spread evenly between the first and the last",
          different, kept.size()));
    } else {
      say(different == 0 ? "no times: assuming 10 scans a second"
                         : "the times do not rise from scan to scan: assuming 10 scans a second");
    }
    report_copies();
    for (std::size_t i = 0; i < scans_.size(); ++i)
      order_.push_back({scans_[i], begin + static_cast<double>(i) * step, true});
    return result();
  }

  std::vector<double> times_;
  std::string what_;
  const MendOptions& options_;
  std::vector<std::size_t> scans_;  ///< Without copies, as the data set has them.
  std::vector<Placed> order_;
  double step_ = 0.0;                                       ///< Usual step [s].
  double shift_ = 0.0;                                      ///< Added to stamps after the clock stepped back.
  double last_ = -std::numeric_limits<double>::infinity();  ///< Latest stamp that is believed.
  double furthest_back_ = 0.0, longest_jump_ = 0.0;
  Tally copies_, late_, wrong_, missing_, back_, jumps_;
  std::vector<std::string> warnings_;
};

}  // namespace

MendedStamps mend_stamps(const std::vector<double>& times_s, const std::string& what,
                         const MendOptions& options) {
  return Mender(times_s, what, options).run();
}

}  // namespace hp2
