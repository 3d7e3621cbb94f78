#include "player/readers/bags/cloud_times.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include <fmt/format.h>

#include "common/error.hpp"
#include "player/readers/bags/cloud_message.hpp"
#include "player/sweep/stamp_mender.hpp"

namespace hp2 {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kLongestSweep_s = 10.0;  // times further from zero are instants, not times in a sweep
constexpr double kSameClock_s = 2.0;      // a header is never later than that after its points
constexpr double kSteadyOffset_s = 0.5;   // spread of the offset between two clocks that run alike
constexpr double kRemarkableOffset_s = 5e-3;
constexpr std::size_t kSamples = 5;

/// Stamps and times of a message, in the order in which the recording stores them.
struct Entry {
  MessageRef ref;
  double header_s = kNone;
  double start_s = kNone;  ///< By the points' own times.
  std::uint32_t layout = 0;
  double raw_start = 0.0;
};

double quantile(std::vector<double> v, double q) {
  const auto at = v.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(v.size() - 1));
  std::nth_element(v.begin(), at, v.end());
  return *at;
}

/// Times that are missing (not finite, or 0 among instants) become the earliest of the others. The earliest,
/// or nothing.
double fill_missing(std::vector<double>& raw) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  std::size_t missing = 0, zeros = 0;
  for (const double t : raw) {
    zeros += t == 0.0;
    missing += !std::isfinite(t);
    if (!std::isfinite(t) || t == 0.0) continue;
    low = std::min(low, t);
    high = std::max(high, t);
  }
  if (!(low <= high)) return zeros > 0 ? 0.0 : kNone;
  const bool zeros_are_missing = low > 10.0 * (high - low);
  if (zeros > 0 && !zeros_are_missing) low = std::min(low, 0.0);
  if (2 * missing > raw.size()) return low;
  if (missing > 0 || (zeros > 0 && zeros_are_missing))
    for (double& t : raw)
      if (!std::isfinite(t) || (t == 0.0 && zeros_are_missing)) t = low;
  return low;
}

/// Reads messages of one topic.
class Reader {
 public:
  Reader(const Recording& recording, const BagTopic& topic) : recording_(recording), topic_(topic) {}

  const CloudMessage& head(const MessageRef& ref) {
    parse_cloud_head(recording_.read(ref, kCloudHeadBytes, memory_), topic_.type, topic_.encoding, where(),
                     message_);
    return message_;
  }
  /// The points' times as they are; none if the message has none.
  std::vector<double>& times(const MessageRef& ref) {
    parse_cloud(recording_.read(ref, kMaxFileBytes, memory_), topic_.type, topic_.encoding, where(),
                message_);
    raw_.clear();
    if (message_.columns.time.first) read_column(message_.columns.time, message_.points, raw_);
    return raw_;
  }
  /// Whether two messages are the same but for their headers' numbers and stamps.
  bool same(const MessageRef& a, const MessageRef& b) {
    constexpr std::size_t kNumberAndStamp = 12;
    MessageBytes other;
    try {
      const std::string_view x = recording_.read(a, kMaxFileBytes, memory_);
      const std::string_view y = recording_.read(b, kMaxFileBytes, other);
      return x.size() == y.size() && x.size() > kNumberAndStamp &&
             x.substr(kNumberAndStamp) == y.substr(kNumberAndStamp);
    } catch (const Error&) {
      return false;
    }
  }

 private:
  std::string where() const { return recording_.path() + ", " + topic_.name; }
  const Recording& recording_;
  const BagTopic& topic_;
  MessageBytes memory_;
  CloudMessage message_;
  std::vector<double> raw_;
};

/// Headers and layouts of all messages. A damaged one is reported when it is its turn to be played.
std::vector<Entry> read_heads(Reader& reader, const BagTopic& topic,
                              std::map<std::string, std::uint32_t>& layouts, std::vector<bool>& has_base,
                              std::string& frame) {
  std::vector<Entry> entries;
  for (const MessageRef& ref : topic.refs) {
    Entry entry;
    entry.ref = ref;
    try {
      const CloudMessage& head = reader.head(ref);
      const auto [layout, added] = layouts.emplace(head.layout, static_cast<std::uint32_t>(layouts.size()));
      if (added) has_base.push_back(head.base_us.has_value());
      entry.layout = layout->second;
      if (head.header.stamp_us > 0) entry.header_s = static_cast<double>(head.header.stamp_us) * 1e-6;
      if (head.base_us) entry.start_s = static_cast<double>(*head.base_us) * 1e-6;
      if (frame.empty()) frame = head.header.frame;
    } catch (const Error&) {
      entry.layout = 0;
    }
    entries.push_back(entry);
  }
  if (layouts.empty()) {
    layouts.emplace("", 0);
    has_base.push_back(false);
  }
  return entries;
}

/// Order in which the messages were recorded.
std::vector<std::size_t> recorded_order(const std::vector<Entry>& entries) {
  std::vector<std::size_t> order(entries.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return entries[a].ref.utime < entries[b].ref.utime; });
  return order;
}

/// The header's stamp of each message in `order`; the times of recording if no header has one.
std::vector<double> header_times(const std::vector<Entry>& entries, const std::vector<std::size_t>& order) {
  std::vector<double> times;
  for (const std::size_t i : order) times.push_back(entries[i].header_s);
  if (std::none_of(times.begin(), times.end(), [](double t) { return std::isfinite(t); }))
    for (std::size_t k = 0; k < order.size(); ++k)
      times[k] = static_cast<double>(entries[order[k]].ref.utime) * 1e-6;
  return times;
}

/// Unit of each layout's times, from its first messages that have any.
std::vector<TimeUnit> find_units(Reader& reader, const std::vector<Entry>& entries,
                                 const std::vector<std::size_t>& order, std::int64_t sweep_us,
                                 const std::vector<bool>& has_base, std::vector<bool>& absolute,
                                 const std::string& path, std::vector<std::string>& warnings) {
  const std::size_t n = has_base.size();
  absolute.assign(n, false);
  std::vector<std::vector<std::vector<double>>> samples(n);
  std::vector<std::size_t> tried(n, 0);
  for (const std::size_t i : order) {
    const Entry& entry = entries[i];
    if (tried[entry.layout]++ >= kSamples) continue;
    try {
      std::vector<double>& raw = reader.times(entry.ref);
      fill_missing(raw);
      if (!raw.empty()) samples[entry.layout].push_back(raw);
    } catch (const Error&) {
      // A damaged scan is reported when it is its turn to be played.
    }
  }
  std::vector<TimeUnit> units(n);
  for (std::size_t layout = 0; layout < n; ++layout) {
    if (samples[layout].empty()) continue;
    units[layout] = find_time_unit(samples[layout], sweep_us, has_base[layout] ? 1e-9 : 0.0);  // Livox: ns
    std::vector<double> lows;
    bool all_equal = true;
    for (const auto& sample : samples[layout]) {
      const auto [low, high] = std::minmax_element(sample.begin(), sample.end());
      lows.push_back(*low);
      all_equal = all_equal && !(*low < *high);
    }
    absolute[layout] = !has_base[layout] && quantile(lows, 0.5) * units[layout].unit_s > kLongestSweep_s;
    if (all_equal)
      warnings.push_back(
          "the points' times in " + path +
          " are all equal within a scan: they are of no use, and scans are not deskewed by them");
    else if (units[layout].unit_s == 0.0 && !units[layout].normalised)
      warnings.push_back("the unit of the points' times in " + path +
                         " cannot be told: each scan's times are stretched over a whole sweep");
  }
  return units;
}

/// Start of the sweep by the points' times, in their unit.
double find_start(std::vector<double>& raw, const TimeUnit& unit) {
  const double low = fill_missing(raw);
  if (raw.empty() || !std::isfinite(low)) return kNone;
  const double longest = 3.0 * static_cast<double>(unit.duration_us) * 1e-6 / unit.unit_s;
  const double high = *std::max_element(raw.begin(), raw.end());
  if (high - low <= longest) return low;
  // Some of the times are invalid: those within about a sweep before the median are valid.
  const double earliest = quantile(raw, 0.5) - 0.5 * longest;
  double start = high;
  for (const double t : raw)
    if (t >= earliest) start = std::min(start, t);
  return start;
}

void find_starts(Reader& reader, const std::vector<TimeUnit>& units, const std::vector<bool>& absolute,
                 std::vector<Entry>& entries) {
  for (Entry& entry : entries) {
    const TimeUnit& unit = units[entry.layout];
    if (!absolute[entry.layout] || unit.unit_s <= 0.0 || std::isfinite(entry.start_s)) continue;
    try {
      entry.raw_start = find_start(reader.times(entry.ref), unit);
    } catch (const Error&) {
      entry.raw_start = kNone;
    }
    entry.start_s = entry.raw_start * unit.unit_s;
  }
}

/// Puts the points' instants in the place of the headers' stamps.
void prefer_points(std::vector<Entry>& entries, const std::string& path, std::vector<std::string>& warnings) {
  std::vector<double> late;  // header behind the points
  for (const Entry& e : entries)
    if (std::isfinite(e.header_s) && std::isfinite(e.start_s)) late.push_back(e.header_s - e.start_s);
  const double typical = late.empty() ? 0.0 : quantile(late, 0.5);
  const double spread = late.empty() ? 0.0 : quantile(late, 0.95) - quantile(late, 0.05);
  const bool same_clock = std::abs(typical) < kSameClock_s;
  if (!same_clock && spread > kSteadyOffset_s)
    return;  // two clocks that drift apart: the headers' is everyone's
  for (Entry& e : entries)
    if (std::isfinite(e.start_s)) e.header_s = same_clock ? e.start_s : e.start_s + typical;
  if (!same_clock)
    warnings.push_back(
        fmt::format("the points' times in {} are of another clock, {:.3f} s behind the headers' stamps: "
                    "the stamps are the points' times with that added",
                    path, typical));
  else if (std::abs(typical) > kRemarkableOffset_s || spread > kRemarkableOffset_s)
    warnings.push_back(
        fmt::format("the headers' stamps in {} lie {:.0f} ms behind the first points' times and vary by "
                    "{:.0f} ms: the points' times are used",
                    path, typical * 1e3, spread * 1e3));
}

}  // namespace

TimedClouds time_clouds(const Recording& recording, const BagTopic& topic,
                        std::vector<std::string>& warnings) {
  TimedClouds clouds;
  Reader reader(recording, topic);
  std::map<std::string, std::uint32_t> layouts;
  std::vector<bool> has_base;
  std::vector<Entry> entries = read_heads(reader, topic, layouts, has_base, clouds.frame);
  const std::vector<std::size_t> order = recorded_order(entries);
  const std::string what = "the messages' headers in " + recording.path();

  MendOptions options;
  options.same_points = [&](std::size_t a, std::size_t b) {
    return reader.same(entries[order[a]].ref, entries[order[b]].ref);
  };
  const std::int64_t sweep_us = estimate_sweep(mend_stamps(header_times(entries, order), what).stamps_us);
  clouds.units =
      find_units(reader, entries, order, sweep_us, has_base, clouds.absolute, recording.path(), warnings);
  find_starts(reader, clouds.units, clouds.absolute, entries);
  prefer_points(entries, recording.path(), warnings);

  const MendedStamps mended = mend_stamps(header_times(entries, order), what, options);
  warnings.insert(warnings.end(), mended.warnings.begin(), mended.warnings.end());
  for (std::size_t k = 0; k < mended.order.size(); ++k) {
    const Entry& entry = entries[order[mended.order[k]]];
    clouds.scans.push_back({entry.ref, mended.stamps_us[k] + clouds.units[entry.layout].start_us,
                            entry.layout, std::isfinite(entry.raw_start) ? entry.raw_start : 0.0});
  }
  for (std::size_t l = 0; l < clouds.units.size() && clouds.time_in_sweep.empty(); ++l)
    if (clouds.units[l].duration_us > 0)
      clouds.time_in_sweep = describe(clouds.units[l]) + (clouds.absolute[l] ? ", absolute" : "");
  if (clouds.scans.empty())
    throw Error("the topic " + topic.name + " holds no scan", recording.path(),
                "Choose another with --topic.");
  return clouds;
}

void apply_cloud_times(const TimedClouds& clouds, const TimedCloud& cloud, std::vector<double>& raw,
                       Scan& scan) {
  if (raw.empty()) return;
  const double low = fill_missing(raw);
  if (clouds.absolute[cloud.layout] && (cloud.raw_start > 0.0 || low > 0.0)) {
    const double start = cloud.raw_start > 0.0 ? cloud.raw_start : low;
    for (double& t : raw) t = std::max(t - start, 0.0);
  }
  apply_times(raw, clouds.units[cloud.layout], scan);
}

}  // namespace hp2
