#include "player/sweep/drive_sweep.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include "common/error.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/sweep/stretch.hpp"
#include "player/sweep/sweep_choice.hpp"
#include "player/sweep/sweep_trial.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kStretchesTried = 6;  // in search of motion
constexpr std::size_t kStretchesCounted = 4;
// Ten seconds of motion must agree before times are made up: a shorter drive is taken as it is.
constexpr std::size_t kStretchesNeeded = 4;
constexpr std::int64_t kLongestSweep_us = 210'000;

double median_step(const std::vector<std::int64_t>& stamps) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < stamps.size(); ++i)
    steps.push_back(static_cast<double>(stamps[i] - stamps[i - 1]));
  if (steps.empty()) return 0.0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

/// Number of the turn of each stamp, gaps counted; empty if the sensor does not turn evenly.
std::vector<std::int64_t> turns_of(const std::vector<std::int64_t>& stamps, double period_us) {
  std::vector<std::int64_t> turns{0};
  std::size_t odd = 0;
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const double steps = static_cast<double>(stamps[i] - stamps[i - 1]) / period_us;
    const auto turn = std::max<std::int64_t>(std::llround(steps), 1);
    if (steps < 50.0 && std::abs(steps - static_cast<double>(turn)) > 0.2) ++odd;
    turns.push_back(turns.back() + turn);
  }
  if (20 * odd > stamps.size()) return {};
  return turns;
}

bool near(double a_rad, double b_rad) { return std::abs(std::remainder(a_rad - b_rad, 2.0 * M_PI)) < 0.3; }

SweepReading turning(bool clockwise, double cut_deg) {
  return {SweepReading::Kind::kAzimuth, clockwise, cut_deg * M_PI / 180.0};
}

/// In hundredths of a degree, so that the reading's name says it exactly.
double rounded_deg(double angle_rad) { return std::round(angle_rad * 18000.0 / M_PI) / 100.0; }

/// The readings that the order of the points leaves open; none if the sensor does not spin.
std::vector<SweepReading> likely_readings(const PointOrder& order) {
  std::vector<SweepReading> readings;
  if (!order.spins) return readings;
  readings.push_back({});
  if (order.one_turn) {  // the order of firing
    if (!order.has_cut) return {};
    readings.push_back(turning(order.clockwise, rounded_deg(order.cut_rad)));
    return readings;
  }
  // Ring by ring. A program that has sorted the points may have begun anywhere: most sensors do so behind.
  std::vector<double> cuts_deg{180.0};
  if (order.has_cut && !near(order.cut_rad, M_PI)) cuts_deg.push_back(rounded_deg(order.cut_rad));
  for (const double cut_deg : cuts_deg)
    for (const bool clockwise : {true, false}) readings.push_back(turning(clockwise, cut_deg));
  return readings;
}

/// Whether the times of the points, or these reversed, are about what `reading` makes of them.
bool times_fit(const Scan& scan, const SweepReading& reading) {
  constexpr double kNear = 0.1;  // of a sweep; beams do not look into quite the same azimuth
  double as_given = 0.0, reversed = 0.0, n = 0.0;
  for (std::size_t i = 0; i < scan.size(); i += 7) {
    const auto t = static_cast<double>(time_of_azimuth(reading, std::atan2(scan.y[i], scan.x[i])));
    as_given += std::abs(static_cast<double>(scan.time[i]) - t);
    reversed += std::abs(1.0 - static_cast<double>(scan.time[i]) - t);
    n += 1.0;
  }
  return std::min(as_given, reversed) < kNear * n;
}

/// The readings of points with times: as given, and in which way they may be wrong. Those by azimuth only
/// where the times fit no place at which a sweep may begin.
std::vector<SweepReading> readings_with_times(const Scan& scan, const PointOrder& order) {
  using Kind = SweepReading::Kind;
  std::vector<SweepReading> readings{{Kind::kGiven, true, 0.0}, {}, {Kind::kReversed, true, 0.0}};
  if (scan.time.size() != scan.size()) return readings;
  std::vector<SweepReading> turns;
  for (const SweepReading& r : likely_readings(order))
    if (r.kind == Kind::kAzimuth) turns.push_back(r);
  const auto fits = [&](const SweepReading& r) { return times_fit(scan, r); };
  if (std::none_of(turns.begin(), turns.end(), fits))
    readings.insert(readings.end(), turns.begin(), turns.end());
  return readings;
}

class Settlement {
 public:
  explicit Settlement(Drive& drive) : drive_(drive) {
    for (const DriveScan& s : drive.scans) stamps_.push_back(s.utime);
    has_times_ = std::any_of(drive.scans.begin(), drive.scans.end(),
                             [](const DriveScan& s) { return s.duration_us > 0; });
    even_ = even_stamps(stamps_);
  }

  bool has_times() const { return has_times_; }
  void apply(const SweepReading& reading);
  std::optional<SweepReading> compare(std::size_t first);

 private:
  std::int64_t sweep_us() const {
    return has_times_ ? drive_.scans.front().duration_us : std::llround(median_step(even_));
  }

  Drive& drive_;
  std::vector<std::int64_t> stamps_, even_;
  bool has_times_ = false;
};

std::optional<SweepReading> Settlement::compare(std::size_t first) {
  const double step_us = median_step(stamps_);
  if (drive_.scans.size() < first + 12 || step_us <= 0.0 || step_us > kLongestSweep_us) return std::nullopt;
  if (turns_of(stamps_, step_us).empty()) return std::nullopt;  // thinned: too little in common
  std::optional<SweepComparison> comparison;
  const SweepComparison::Demand demand =
      has_times_ ? SweepComparison::Demand{4.0, 0.01} : SweepComparison::Demand{3.0, 0.005};
  bool all_cuts = true;  // the right one is among the readings, if the points are distorted
  std::optional<SweepReading> found;
  std::size_t counted = 0, begin = first, skip = kStretch;
  for (std::size_t tried = 0; tried < kStretchesTried && begin + 12 <= drive_.scans.size(); ++tried) {
    const std::vector<Scan> scans = read_stretch(drive_, begin, kStretch);
    if (!comparison && !scans.empty()) {
      std::vector<const Scan*> few;
      for (std::size_t i = 0; i < scans.size(); i += 5) few.push_back(&scans[i]);
      const PointOrder order = order_of_points(few);
      const auto readings = has_times_ ? readings_with_times(scans.front(), order) : likely_readings(order);
      if (readings.empty()) return std::nullopt;
      all_cuts = has_times_ || order.has_cut;
      comparison.emplace(readings, 1e-6 * static_cast<double>(sweep_us()), scale_of_scene(scans.front()));
    }
    if (comparison && comparison->add_stretch(thin_stretch(scans, even_, begin, comparison->scale()))) {
      spdlog::debug("sweep, scans from {}: {}", begin, comparison->to_text());
      const auto best = comparison->best(demand);
      if (!found && best && (all_cuts || best->kind != SweepReading::Kind::kCompensated)) found = best;
      if (found && comparison->leader() != *found) found.reset();  // later stretches speak against it
      if (found && (has_times_ || counted + 1 >= kStretchesNeeded)) return found;
      if (has_times_ && comparison->first_leads()) return std::nullopt;
      if (++counted == kStretchesCounted) break;
      begin += kStretch;
    } else {  // it stands: look further ahead each time
      begin += skip;
      skip *= 2;
    }
  }
  return std::nullopt;
}

void Settlement::apply(const SweepReading& reading) {
  if (reading.kind == SweepReading::Kind::kGiven) return;
  if (!has_times_ && reading.kind != SweepReading::Kind::kAzimuth) return;
  if (!has_times_) {
    const std::int64_t duration = sweep_us();
    std::vector<std::int64_t> ends;
    for (std::size_t i = 0; i < drive_.scans.size(); ++i) {
      DriveScan& scan = drive_.scans[i];
      scan.duration_us = duration;
      scan.utime = even_[i] - std::llround(drive_.stamp_in_sweep * static_cast<double>(duration));
      ends.push_back(scan.utime_end());
    }
    if (!drive_.ground_truth.empty()) drive_.ground_truth = shift_poses(drive_.ground_truth, stamps_, ends);
  }
  drive_.decode = [reading, inner = std::move(drive_.decode)](const DriveScan& entry, Scan& scan) {
    inner(entry, scan);
    apply_reading(reading, scan);
  };
}

std::string remark(const SweepReading& reading, bool has_times) {
  switch (reading.kind) {
    case SweepReading::Kind::kCompensated:
      return has_times
                 ? "the points have times, but agree best as they are: they are motion-compensated already "
                   "and are not deskewed (--sweep given uses the times)"
                 : "the points have no times and agree best as they are: they are motion-compensated already";
    case SweepReading::Kind::kReversed:
      return "the points' times run backwards: the scans agree best with the times reversed, and are "
             "deskewed so "
             "(--sweep given uses the times as they are)";
    default:
      return has_times
                 ? "the points' times do not fit their directions: the scans agree best as " +
                       to_text(reading) + ", and are deskewed so (--sweep given uses the times as they are)"
                 : "the points have no times; the scans agree best as " + to_text(reading) +
                       ", and are deskewed so (--sweep compensated takes them as they are)";
  }
}

}  // namespace

std::vector<std::int64_t> even_stamps(const std::vector<std::int64_t>& stamps) {
  const double period_us = median_step(stamps);
  if (stamps.size() < 3 || period_us <= 0.0) return stamps;
  const std::vector<std::int64_t> turns = turns_of(stamps, period_us);
  if (turns.empty()) return stamps;
  // A line through the stamps nearby: the speed of the motor changes slowly.
  constexpr std::size_t kNear = 15;
  std::vector<std::int64_t> even;
  for (std::size_t i = 0; i < stamps.size(); ++i) {
    const std::size_t begin = i > kNear ? i - kNear : 0, end = std::min(i + kNear + 1, stamps.size());
    double n = 0.0, st = 0.0, su = 0.0, stt = 0.0, stu = 0.0;
    for (std::size_t j = begin; j < end; ++j) {
      const auto turn = static_cast<double>(turns[j] - turns[i]);
      if (std::abs(turn) > 3.0 * kNear) continue;
      const auto utime = static_cast<double>(stamps[j] - stamps[i]);
      n += 1.0;
      st += turn;
      su += utime;
      stt += turn * turn;
      stu += turn * utime;
    }
    const double determinant = n * stt - st * st;
    const double offset = determinant > 0.0 ? (stt * su - st * stu) / determinant : 0.0;
    const bool small = std::abs(offset) < 0.3 * period_us;
    even.push_back(stamps[i] + (small ? std::llround(offset) : 0));
    if (even.size() > 1 && even.back() <= even[even.size() - 2]) return stamps;
  }
  return even;
}

std::string name_of_sweep(const SweepReading& reading) {
  switch (reading.kind) {
    case SweepReading::Kind::kGiven:
      return "given";
    case SweepReading::Kind::kCompensated:
      return "compensated";
    case SweepReading::Kind::kReversed:
      return "reversed";
    case SweepReading::Kind::kAzimuth:
      break;
  }
  return fmt::format("{}:{:.2f}", reading.clockwise ? "clockwise" : "counterclockwise",
                     reading.cut_rad * 180.0 / M_PI);
}

SweepReading parse_sweep(const std::string& name) {
  using Kind = SweepReading::Kind;
  if (name == "compensated") return {Kind::kCompensated, true, 0.0};
  if (name == "reversed") return {Kind::kReversed, true, 0.0};
  const std::size_t colon = name.find(':');
  const std::string turn = name.substr(0, colon);
  double degrees = 180.0;
  bool good = turn == "clockwise" || turn == "counterclockwise";
  if (good && colon != std::string::npos) {
    const char* const end = name.data() + name.size();
    const auto [rest, error] = std::from_chars(name.data() + colon + 1, end, degrees);
    good = error == std::errc() && rest == end && std::abs(degrees) <= 360.0;
  }
  if (!good)
    throw Error(
        "the sweep \"" + name + "\" is not understood", "--sweep",
        "Write auto, given, compensated, reversed, clockwise or counterclockwise; the last two may name "
        "the azimuth at which a sweep begins, as in clockwise:90.");
  return turning(turn == "clockwise", degrees);
}

void settle_sweep(Drive& drive, const std::string& choice, std::size_t first) {
  if (choice == "given" || drive.scans.empty()) return;
  Settlement settlement(drive);
  if (choice != "auto") {
    const SweepReading reading = parse_sweep(choice);
    settlement.apply(reading);
    drive.sweep = choice;
    drive.warnings.push_back("the sweep is read as chosen by hand: " + to_text(reading));
    return;
  }
  if (!drive.sweep_in_doubt) return;
  const auto found = settlement.compare(first);
  if (!found || found->kind == SweepReading::Kind::kGiven) return;
  settlement.apply(*found);
  drive.sweep = name_of_sweep(*found);
  drive.time_in_sweep = to_text(*found) + ", as the scans agree best";
  if (!settlement.has_times() && found->kind == SweepReading::Kind::kCompensated)
    spdlog::info("{}", remark(*found, false));  // nothing changes by it
  else
    drive.warnings.push_back(remark(*found, settlement.has_times()));
}

}  // namespace hp2
