#include "frontend/process/scan_streams.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/transport/crc32.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kSilenceUs = 2'000'000;
constexpr std::size_t kMostHeld = 8, kMostOthers = 4, kMostRecent = 64;
constexpr std::int64_t kLongestStepUs = 3'600'000'000;
constexpr std::int64_t kSmallGap = 10, kGapWithoutStamps = 100, kGapOfAnInterruption = 3000;
constexpr double kSoonest = 0.8,
                 kLatest = 1.25;  // of the usual step: by its stamp this scan is the next
// Of the duration: two sweeps of one sensor do not begin as close together. More than half, so that two
// sensors without numbers are told apart wherever their sweeps lie.
constexpr double kOverlap = 0.6;
constexpr double kSilentIntervals = 2.5;
constexpr std::int64_t kUnknownIntervalUs = 100'000, kLongestIntervalUs = 400'000;

bool is_usual(std::int64_t step_us, std::int64_t usual_us) {
  const auto step = static_cast<double>(step_us), usual = static_cast<double>(usual_us);
  return usual_us > 0 && step >= kSoonest * usual && step <= kLatest * usual;
}

// Of its points and its stamp, whatever its number is.
std::uint64_t fingerprint(const Scan& scan) {
  const auto sum = [](const std::vector<float>& v, std::uint32_t crc) {
    return v.empty() ? crc : crc32(v.data(), v.size() * sizeof(float), crc);
  };
  const auto stamp = static_cast<std::uint64_t>(scan.utime);
  const std::uint64_t points = std::uint64_t{sum(scan.x, 0)} << 32U | sum(scan.z, sum(scan.y, 0));
  return points ^ (stamp * 0x9E3779B97F4A7C15ULL) ^ scan.size();
}

}  // namespace

ScanStreams::Stream ScanStreams::begin(const Scan& scan, std::int64_t sender, std::int64_t now_us) {
  Stream s;
  s.sensor = scan.sensor;
  s.sender = sender;
  s.sequence = scan.sequence;
  s.utime = scan.utime;
  s.duration_us = scan.duration_us;
  s.heard_us = now_us;
  return s;
}

// A driver may send small scans whole, which name no sender, and large ones in pieces.
bool ScanStreams::same_source(const Stream& stream, const Scan& scan, std::int64_t sender) {
  return stream.sensor == scan.sensor && (stream.sender == 0 || sender == 0 || stream.sender == sender);
}

ScanStreams::Fit ScanStreams::fit(const Stream& s, const Scan& scan, std::int64_t sender) {
  if (!same_source(s, scan, sender)) return Fit::kNo;
  const std::int64_t step = scan.utime - s.utime;
  if (scan.sequence < 0) {
    if (step == 0 && scan.utime == 0) return Fit::kNumber;  // without number and stamp: by arrival
    return step > 0 && static_cast<double>(step) >= kOverlap * static_cast<double>(scan.duration_us)
               ? Fit::kNumber
               : Fit::kNo;
  }
  if (scan.sequence == s.sequence + 1 || (s.other_sequence >= 0 && scan.sequence == s.other_sequence + 1))
    return Fit::kNumber;
  const std::int64_t usual = s.steps >= 2 ? s.period_us : scan.duration_us;
  if (is_usual(step, usual)) return Fit::kStamp;
  const std::int64_t gap = scan.sequence - s.sequence;
  if (gap <= 1) return Fit::kNo;
  if (usual > 0 && step > 0 && step < kLongestStepUs) {
    const double steps = static_cast<double>(step) / static_cast<double>(usual);
    const bool as_stamp = std::abs(static_cast<double>(gap) - steps) <= 1.0 + 0.3 * steps;
    return as_stamp || gap <= kSmallGap ? Fit::kGap : Fit::kNo;
  }
  return gap <= kGapWithoutStamps ? Fit::kGap : Fit::kNo;
}

void ScanStreams::advance(Stream& s, const Scan& scan, std::int64_t sender, std::int64_t now_us, Fit fit) {
  const std::int64_t step = scan.utime - s.utime;
  const std::int64_t gap = fit == Fit::kGap ? scan.sequence - s.sequence : 1;
  if (step > 0 && step / gap < kLongestStepUs) {
    // The first steps count in full, later ones a little: one odd stamp does not change what is usual.
    const double weight = s.steps < 4 ? 1.0 / (s.steps + 1) : is_usual(step / gap, s.period_us) ? 0.1 : 0.02;
    s.period_us += static_cast<std::int64_t>(weight * static_cast<double>(step / gap - s.period_us));
    ++s.steps;
  }
  if (fit == Fit::kGap) {
    s.missing_first = s.sequence + 1;
    s.missing_end = scan.sequence;
  }
  if (fit == Fit::kStamp) {
    s.other_sequence = scan.sequence;
    if (s.sequence >= 0) ++s.sequence;
  } else {
    s.other_sequence = -1;
    s.sequence = scan.sequence;
  }
  if (sender != 0) s.sender = sender;
  s.utime = scan.utime;
  s.duration_us = scan.duration_us;
  const std::int64_t interval = std::min(now_us - s.heard_us, kLongestIntervalUs);
  s.interval_us = s.interval_us == 0 ? interval : s.interval_us + (interval - s.interval_us) / 8;
  s.heard_us = now_us;
}

bool ScanStreams::duplicate(const Scan& scan) {
  const std::uint64_t key = fingerprint(scan);
  if (std::find(recent_.begin(), recent_.end(), key) != recent_.end()) return true;
  recent_.push_back(key);
  if (recent_.size() > kMostRecent) recent_.pop_front();
  return false;
}

bool ScanStreams::active(std::int64_t now_us) const {
  return last_us_ != 0 && now_us - last_us_ < kSilenceUs;
}

Scan ScanStreams::numbered(Scan scan, std::int64_t skipped) {
  const std::int64_t number = next_ + skipped;
  if (scan.sequence >= 0 && !begun_) {
    // In a continued session the producer's scans since then are missing. A new one begins at 0.
    const bool later = next_ > 0 && scan.sequence >= next_ && scan.sequence - next_ < kGapOfAnInterruption;
    next_ = later ? scan.sequence : number;
  } else {
    next_ = number;
  }
  scan.sequence = next_++;
  return scan;
}

void ScanStreams::remark(const std::string& kind, const std::string& text) {
  if (told_.insert(kind).second) remarks_.push_back(text);
}

// The number of the scan before did not fit its stamp; this one shows whether the producer continues from
// there.
void ScanStreams::tell_about_number(const Scan& scan) {
  const std::int64_t odd = current_.other_sequence;
  if (odd < 0) return;
  if (scan.sequence == odd + 1) {
    ++counts_["live_streams"];
    remark("restart",
           "the producer of the live scans counts from " + std::to_string(odd) + " on where " +
               std::to_string(current_.sequence) +
               " was due (a driver that was started again?): the scans' own numbers go on without a gap");
  } else {
    remark("number",
           "the number " + std::to_string(odd) +
               " of a live scan does not fit those before and after it, but "
               "its stamp does: it was taken as the next. Number scans from 0 on, rising by 1, or all -1");
  }
}

void ScanStreams::leave_out(Stream& stream, const char* reason) {
  counts_[reason] += static_cast<std::int64_t>(stream.held.size());
  stream.held.clear();
}

std::vector<Scan> ScanStreams::go_on(Scan scan, std::int64_t sender, std::int64_t now_us, Fit fit) {
  if (fit == Fit::kNumber || fit == Fit::kGap) tell_about_number(scan);
  if (fit == Fit::kStamp) {
    ++counts_["live_scans_renumbered"];
    if (current_.other_sequence >= 0) {
      remark("numbers",
             "the numbers of the live scans do not rise by 1 from scan to scan: scans are numbered as they "
             "come. Number them from 0 on, rising by 1, or all -1");
    }
  }
  const std::int64_t skipped = fit == Fit::kGap ? scan.sequence - current_.sequence - 1 : 0;
  advance(current_, scan, sender, now_us, fit);
  for (Stream& other : others_) {
    other.overlapped = true;
    if (other.held.empty()) continue;
    const bool alien = !same_source(current_, other.held.front(), other.sender);
    leave_out(other, alien ? "live_scans_other_sender" : "live_scans_bad_number");
  }
  std::vector<Scan> out;
  out.push_back(numbered(std::move(scan), skipped));
  begun_ = true;
  last_us_ = now_us;
  return out;
}

std::vector<Scan> ScanStreams::switch_to(std::size_t other, std::int64_t now_us) {
  Stream next = std::move(others_[other]);
  others_.erase(others_.begin() + static_cast<std::ptrdiff_t>(other));
  const std::int64_t before = current_.sequence;
  std::vector<Scan> out;
  ++counts_["live_streams"];
  if (!next.held.empty() && before >= 0 && next.held.front().sequence >= 0) {
    remark("restart",
           "the producer of the live scans counts from " + std::to_string(next.held.front().sequence) +
               " on where " + std::to_string(before + 1) +
               " was due (a driver that was started again?): the scans' own numbers go on without a gap");
  }
  for (Scan& scan : next.held) out.push_back(numbered(std::move(scan), 0));
  next.held.clear();
  next.overlapped = next.foreign = false;
  if (next.steps < 2 && next.sensor == current_.sensor) {
    next.period_us = current_.period_us;
    next.steps = current_.steps;
  }
  current_ = std::move(next);
  last_us_ = now_us;
  return out;
}

void ScanStreams::forget_silent(std::int64_t now_us) {
  for (auto it = others_.begin(); it != others_.end();) {
    if (now_us - it->heard_us < kSilenceUs) {
      ++it;
      continue;
    }
    leave_out(*it, "live_scans_bad_number");
    if (!it->foreign) {
      remark("bad number",
             "a live scan's number and stamp fitted neither the scans before it nor those after it: it "
             "was left out and counted (live_scans_bad_number)");
    }
    it = others_.erase(it);
  }
}

std::vector<Scan> ScanStreams::take(Scan scan, std::int64_t sender, std::int64_t now_us) {
  if (duplicate(scan)) {
    ++counts_["duplicates"];
    return {};
  }
  const auto continues = [&](const Stream& s) {  // by number and by stamp
    const std::int64_t usual = s.steps >= 2 ? s.period_us : scan.duration_us;
    return fit(s, scan, sender) == Fit::kNumber && is_usual(scan.utime - s.utime, usual);
  };
  const bool heirs = begun_ && !continues(current_) && std::any_of(others_.begin(), others_.end(), continues);
  const Fit now = begun_ && !heirs ? fit(current_, scan, sender) : Fit::kNo;
  if (now != Fit::kNo) return go_on(std::move(scan), sender, now_us, now);
  if (!active(now_us)) {  // no other stream fits it
    if (begun_) ++counts_["live_streams"];
    current_ = begin(scan, sender, now_us);
    others_.clear();
    std::vector<Scan> out;
    out.push_back(numbered(std::move(scan), 0));
    begun_ = true;
    last_us_ = now_us;
    return out;
  }
  if (same_source(current_, scan, sender) && scan.sequence >= current_.missing_first &&
      scan.sequence < current_.missing_end && scan.utime < current_.utime) {
    ++counts_["live_scans_late"];
    remark("late",
           "live scans come in another order than their numbers and stamps have: those that come late are "
           "left out and counted (live_scans_late)");
    return {};
  }
  // One that has begun already, or a new one. While its stream is silent, every scan of the same source
  // belongs to the stream that follows it.
  auto other = std::find_if(others_.begin(), others_.end(), [&](const Stream& s) {
    return same_source(s, scan, sender) &&
           (!s.overlapped || !same_source(current_, scan, sender) || fit(s, scan, sender) != Fit::kNo);
  });
  if (other == others_.end()) {
    if (others_.size() >= kMostOthers) {
      leave_out(others_.front(), "live_scans_bad_number");
      others_.pop_front();
    }
    others_.push_back(begin(scan, sender, now_us));
    others_.back().held.push_back(std::move(scan));
    return {};
  }
  const Fit there = fit(*other, scan, sender);
  advance(*other, scan, sender, now_us, there == Fit::kNo ? Fit::kNumber : there);
  if (other->overlapped) {
    other->foreign = true;
    ++counts_["live_scans_other_sender"];
    remark(
        "two",
        "two producers send scans on the same channel (sensors \"" + current_.sensor + "\" and \"" +
            scan.sensor +
            "\"): those of the one that came second are left out and counted "
            "(live_scans_other_sender). Stop one of them, or give each sensor's run an LCM URL of its own");
    return {};
  }
  other->held.push_back(std::move(scan));
  const bool same = same_source(current_, other->held.back(), sender);
  if (same || other->held.size() >= kMostHeld)
    return switch_to(static_cast<std::size_t>(other - others_.begin()), now_us);
  return {};
}

std::vector<Scan> ScanStreams::poll(std::int64_t now_us) {
  if (others_.empty()) return {};
  const std::int64_t interval = current_.interval_us == 0 ? kUnknownIntervalUs : current_.interval_us;
  const auto patience = static_cast<std::int64_t>(kSilentIntervals * static_cast<double>(interval));
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const Stream& s = others_[i];
    if (!s.overlapped && !s.held.empty() && now_us - current_.heard_us > patience)
      return switch_to(i, now_us);
  }
  forget_silent(now_us);
  return {};
}

std::map<std::string, std::int64_t> ScanStreams::take_counts() { return std::exchange(counts_, {}); }

std::vector<std::string> ScanStreams::take_remarks() { return std::exchange(remarks_, {}); }

}  // namespace hp2
