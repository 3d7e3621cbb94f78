#include "player/readers/bin_layout.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr ScalarType kFloat = ScalarType::kFloat32, kDouble = ScalarType::kFloat64;

// The usual one first, then the short records before the long ones: a long one may be several short ones.
const std::array<BinLayout, 10> kLayouts = {{
    {"xyzi", "float32 x y z intensity", kFloat, 16, 3, -1, -1},
    {"xyz", "float32 x y z", kFloat, 12, -1, -1, -1},
    {"nclt", "NCLT's uint16 x y z, uint8 intensity, uint8 ring", ScalarType::kUint16, 8, 3, 4, -1, true},
    {"xyzir", "float32 x y z intensity ring", kFloat, 20, 3, 4, -1},
    {"xyzit", "float32 x y z intensity time", kFloat, 20, 3, -1, 4},
    {"xyzirt", "float32 x y z intensity ring time", kFloat, 24, 3, 4, 5},
    {"xyz-double", "float64 x y z", kDouble, 24, -1, -1, -1},
    {"xyzi-double", "float64 x y z intensity", kDouble, 32, 3, -1, -1},
    {"xyzir-double", "float64 x y z intensity ring", kDouble, 40, 3, 4, -1},
    {"xyzit-double", "float64 x y z intensity time", kDouble, 40, 3, -1, 4},
}};

constexpr std::size_t kFewPoints = 100;  // fewer give no decision
constexpr double kMostRange_m = 500.0;

double median(std::vector<double> v) {
  if (v.empty()) return 0.0;
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

/// Largest difference of the distributions of two columns (Kolmogorov and Smirnov).
double difference(std::vector<double> a, std::vector<double> b) {
  std::sort(a.begin(), a.end());
  std::sort(b.begin(), b.end());
  double most = 0.0;
  std::size_t j = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    while (j < b.size() && b[j] <= a[i]) ++j;
    most = std::max(most, std::abs(static_cast<double>(i + 1) / static_cast<double>(a.size()) -
                                   static_cast<double>(j) / static_cast<double>(b.size())));
  }
  return most;
}

/// How a file looks when it is read in one layout.
struct Look {
  bool fits = false;        ///< Size is a multiple of the record's.
  double in_range = 0.0;    ///< Share of points with coordinates that a sensor may measure.
  double step = 1.0;        ///< Typical distance of neighbours over their range; 1 for no order at all.
  double separation = 0.0;  ///< Of z from x and from y, as distributions; 0 if columns are mixed up.
  bool extras = true;       ///< Intensities, rings and times may be such.
  bool few = false;

  bool plausible() const {
    return fits && extras && in_range > 0.98 && (few || step < 0.35 || separation > 0.1);
  }
};

/// Values of one column in runs of neighbouring records all over the file.
std::vector<double> sample(const std::vector<double>& all) {
  constexpr std::size_t kRuns = 8, kRun = 512;
  if (all.size() <= kRuns * kRun) return all;
  std::vector<double> some;
  for (std::size_t r = 0; r < kRuns; ++r) {
    const auto begin = all.begin() + static_cast<std::ptrdiff_t>((all.size() - kRun) * r / (kRuns - 1));
    some.insert(some.end(), begin, begin + kRun);
  }
  return some;
}

bool are_rings(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(),
                     [](double v) { return v >= 0.0 && v <= 255.0 && v == std::floor(v); });
}

bool are_times(const std::vector<double>& values) {
  double low = INFINITY, high = -INFINITY;
  std::vector<double> steps;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) return false;
    low = std::min(low, values[i]);
    high = std::max(high, values[i]);
    if (i > 0) steps.push_back(std::abs(values[i] - values[i - 1]));
  }
  return high > low && median(steps) < 0.1 * (high - low);
}

Look look_at(std::string_view bytes, const BinLayout& layout) {
  Look look;
  look.fits = bytes.size() % layout.stride == 0;
  const std::size_t n = bytes.size() / layout.stride;
  if (!look.fits || n == 0) return look;
  look.few = n < kFewPoints;
  PointFile file;
  parse_bin(bytes, "", layout, file);
  const auto column = [&](const std::vector<float>& v) {
    return sample(std::vector<double>(v.begin(), v.end()));
  };
  const std::vector<double> x = column(file.scan.x), y = column(file.scan.y), z = column(file.scan.z);
  std::size_t good = 0, measured = 0;
  std::vector<double> fx, fy, fz, steps, ranges;
  double px = 0.0, py = 0.0, pz = 0.0, pr = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double r = std::hypot(x[i], y[i], z[i]);
    const bool none = !std::isfinite(r) ? std::isnan(x[i]) && std::isnan(y[i]) && std::isnan(z[i]) : r == 0.0;
    if (none) continue;  // how drivers write a beam without a return
    ++measured;
    if (!(r < kMostRange_m && r > 0.01)) continue;
    ++good;
    if (pr > 0.0) steps.push_back(std::hypot(x[i] - px, y[i] - py, z[i] - pz) / (r + pr));
    px = x[i], py = y[i], pz = z[i], pr = r;
    fx.push_back(px), fy.push_back(py), fz.push_back(pz), ranges.push_back(r);
  }
  if (measured == 0) return look;
  look.in_range = static_cast<double>(good) / static_cast<double>(measured);
  if (good == 0 || median(ranges) < 0.1) {
    look.in_range = 0.0;
    return look;
  }
  look.step = median(steps);
  look.separation = std::min(difference(fx, fz), difference(fy, fz));
  if (&layout == &kLayouts[0]) return look;  // the usual one is judged by its points only
  if (layout.intensity >= 0) {
    const std::vector<double> intensity = column(file.scan.intensity);
    look.extras =
        std::count_if(intensity.begin(), intensity.end(), [](double v) { return v >= 0.0 && v < 1e6; }) *
            100 >=
        static_cast<std::ptrdiff_t>(intensity.size()) * 99;
  }
  if (look.few) return look;
  const auto extra = [&](int number) {
    std::vector<double> values;
    const bool byte = layout.nclt;
    const std::size_t at = byte ? 7 : static_cast<std::size_t>(number) * scalar_size(layout.type);
    read_column({bytes.data() + at, layout.stride, byte ? ScalarType::kUint8 : layout.type, false}, n,
                values);
    return sample(values);
  };
  if (layout.ring >= 0) look.extras = look.extras && are_rings(extra(layout.ring));
  if (layout.nclt) {
    const auto rings = extra(layout.ring);
    look.extras = look.extras && *std::max_element(rings.begin(), rings.end()) < 32.0;
  }
  if (layout.time >= 0) look.extras = look.extras && are_times(extra(layout.time));
  return look;
}

std::string percent(double share) { return std::to_string(std::lround(100.0 * share)) + " %"; }

}  // namespace

const BinLayout& kitti_bin_layout() { return kLayouts[0]; }

const BinLayout& bin_layout_of_name(const std::string& name) {
  std::string known;
  for (const BinLayout& layout : kLayouts) {
    if (name == layout.name) return layout;
    known += (known.empty() ? "" : ", ") + std::string(layout.name);
  }
  throw Error("unknown layout of .bin records", name, "Known are: " + known + ".");
}

BinLayoutChoice choose_bin_layout(const std::vector<std::string>& files, const std::string& where) {
  std::array<std::vector<Look>, kLayouts.size()> looks;
  std::size_t judged = 0, bytes = 0;
  for (const std::string& file : files) {
    if (file.empty()) continue;
    ++judged;
    if (bytes == 0) bytes = file.size();
    for (std::size_t k = 0; k < kLayouts.size(); ++k) looks[k].push_back(look_at(file, kLayouts[k]));
  }
  if (judged == 0) return {&kLayouts[0], ""};
  const auto plausible = [&](std::size_t k) {  // in most of the files: one may be damaged
    const auto n =
        std::count_if(looks[k].begin(), looks[k].end(), [](const Look& l) { return l.plausible(); });
    return n > 0 && static_cast<std::size_t>(n) * 2 >= judged;
  };
  const auto step = [&](std::size_t k) {
    std::vector<double> steps;
    for (const Look& look : looks[k])
      if (look.plausible()) steps.push_back(look.step);
    return median(steps);
  };
  const bool few =
      std::all_of(looks[0].begin(), looks[0].end(), [](const Look& l) { return !l.fits || l.few; });
  const bool any_fits = std::any_of(looks[0].begin(), looks[0].end(), [](const Look& l) { return l.fits; });
  if (few && any_fits) return {&kLayouts[0], ""};
  std::size_t best = kLayouts.size();
  for (std::size_t k = 0; k < kLayouts.size(); ++k)
    // A record that is several shorter ones has neighbours as near as those: the shorter one is meant.
    if (plausible(k) && (best == kLayouts.size() || step(k) < 0.67 * step(best))) best = k;
  if (best == 0) return {&kLayouts[0], ""};
  if (best < kLayouts.size()) {
    bool clear = step(best) < 0.35;  // neighbours lie near one another
    for (std::size_t k = best + 1; k < kLayouts.size(); ++k)
      clear = clear && (!plausible(k) || kLayouts[k].stride % kLayouts[best].stride == 0 ||
                        step(k) > 1.5 * step(best));
    if (clear)
      return {&kLayouts[best], where + ": the .bin records are read as " + kLayouts[best].what +
                                   " (--bin-layout " + kLayouts[best].name +
                                   "), which is what their points look like"};
  }
  std::string found, known;
  for (std::size_t k = 0; k < kLayouts.size(); ++k) {
    known += (known.empty() ? "" : ", ") + std::string(kLayouts[k].name);
    const Look& look = looks[k].front();
    if (!look.fits) continue;
    found += (found.empty() ? "" : "; ") + std::string(kLayouts[k].name) + ": " + percent(look.in_range) +
             " of the points within 500 m, neighbours apart by " + percent(2.0 * look.step) +
             " of their range";
  }
  throw Error(
      "the records of the .bin scans are not recognised (" + std::to_string(bytes) + " bytes)", where,
      (found.empty() ? "No known record fits the size. The scan may be truncated: copy the file again. "
                     : "Read as " + found + ". ") +
          "Usual is float32 x y z intensity. Name the layout with --bin-layout: " + known + ".");
}

void parse_bin(std::string_view bytes, const std::string& path, const BinLayout& layout, PointFile& out) {
  if (bytes.size() % layout.stride != 0)
    throw Error("the scan is truncated (" + std::to_string(bytes.size()) + " bytes are no multiple of " +
                    std::to_string(layout.stride) + ")",
                path, "Copy the file again; its records are " + std::string(layout.what) + ".");
  const std::size_t n = bytes.size() / layout.stride, size = scalar_size(layout.type);
  PointColumns columns;
  const auto column = [&](int number) {
    return Column{bytes.data() + static_cast<std::size_t>(number) * size, layout.stride, layout.type, false};
  };
  columns.x = column(0);
  columns.y = column(1);
  columns.z = column(2);
  if (layout.nclt) columns.intensity = {bytes.data() + 6, layout.stride, ScalarType::kUint8, false};
  if (!layout.nclt && layout.intensity >= 0) columns.intensity = column(layout.intensity);
  if (layout.time >= 0) columns.time = column(layout.time);
  if (n == 0) columns.intensity = columns.time = {};
  read_points(columns, n, out);
  if (!layout.nclt) return;
  for (std::size_t i = 0; i < n; ++i) {
    out.scan.x[i] = out.scan.x[i] * 0.005F - 100.0F;
    out.scan.y[i] = 100.0F - out.scan.y[i] * 0.005F;  // to y left, z up
    out.scan.z[i] = 100.0F - out.scan.z[i] * 0.005F;
  }
}

}  // namespace hp2
