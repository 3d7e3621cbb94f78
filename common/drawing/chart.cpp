#include "common/drawing/chart.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace hp2 {

namespace {

const Color kInk{45, 52, 60}, kFaint{225, 229, 233}, kGrey{110, 118, 126}, kWhite{255, 255, 255};
constexpr double kTextPx = 17, kTitlePx = 24, kLeftPx = 95, kRightPx = 30, kBottomPx = 72;

// Where the data lie on the canvas.
struct Frame {
  Axis x, y;
  double left = 0, top = 0, width = 0, height = 0;
  bool log_x = false;

  Eigen::Vector2d operator()(const Eigen::Vector2d& p) const {
    const double px = log_x ? std::log10(p.x()) : p.x();
    return {left + (px - x.low) / (x.high - x.low) * width,
            top + (y.high - p.y()) / (y.high - y.low) * height};
  }
};

bool drawable(const Chart& chart, const Eigen::Vector2d& p) {
  return p.allFinite() && p.cwiseAbs().maxCoeff() < 1e12 && (!chart.log_x || p.x() > 0);
}

void data_range(const Chart& chart, Eigen::Vector2d& low, Eigen::Vector2d& high) {
  const double inf = std::numeric_limits<double>::infinity();
  low = {inf, inf};
  high = {-inf, -inf};
  const auto take = [&](const Eigen::Vector2d& p) {
    if (!drawable(chart, p)) return;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  };
  for (const auto& curve : chart.curves) std::for_each(curve.points.begin(), curve.points.end(), take);
  for (const auto& links : chart.links) {
    for (const auto& line : links.lines) take(line.first), take(line.second);
  }
  if (!low.allFinite()) low = {0, 0}, high = {1, 1};
  if (chart.y_from_zero) low.y() = std::min(low.y(), 0.0);
}

struct LegendEntry {
  std::string name;
  Color color;
  double width, dash, marker;
};

std::vector<LegendEntry> legend(const Chart& chart) {
  std::vector<LegendEntry> out;
  for (const auto& c : chart.curves) {
    if (!c.name.empty()) out.push_back({c.name, c.color, c.width_px, c.dash_px, c.marker_px});
  }
  for (const auto& l : chart.links) {
    if (!l.name.empty() && !l.lines.empty()) out.push_back({l.name, l.color, l.width_px + 0.5, 0, 0});
  }
  return out;
}

double text_width(const std::string& text) { return 0.62 * kTextPx * static_cast<double>(text.size()); }

// The legend lies in rows below the title; returns their number. Draws only if there is a canvas.
int legend_rows(const std::vector<LegendEntry>& entries, double x0, double y0, double width, Canvas* canvas) {
  double x = x0;
  int row = 0;
  for (const auto& e : entries) {
    const double space = 46 + text_width(e.name) + 26;
    if (x > x0 && x + space > x0 + width) x = x0, ++row;
    if (canvas != nullptr) {
      const double y = y0 + row * 26;
      canvas->polyline({{x, y - 6}, {x + 34, y - 6}}, e.color, std::max(e.width, 2.0), e.dash);
      if (e.marker > 0) canvas->disc({x + 17, y - 6}, e.marker, e.color);
      canvas->text({x + 44, y}, e.name, kTextPx, kInk);
    }
    x += space;
  }
  return entries.empty() ? 0 : row + 1;
}

void draw_axes(Canvas& canvas, const Frame& f, const Chart& chart) {
  const double bottom = f.top + f.height, right = f.left + f.width;
  for (std::size_t i = 0; i < f.x.ticks.size(); ++i) {
    const double x = f.left + (f.x.ticks[i] - f.x.low) / (f.x.high - f.x.low) * f.width;
    canvas.polyline({{x, f.top}, {x, bottom}}, kFaint, 1);
    canvas.text({x, bottom + 24}, f.x.labels[i], kTextPx, kGrey, TextAnchor::kMiddle);
  }
  for (std::size_t i = 0; i < f.y.ticks.size(); ++i) {
    const double y = f.top + (f.y.high - f.y.ticks[i]) / (f.y.high - f.y.low) * f.height;
    canvas.polyline({{f.left, y}, {right, y}}, kFaint, 1);
    canvas.text({f.left - 10, y + 6}, f.y.labels[i], kTextPx, kGrey, TextAnchor::kEnd);
  }
  canvas.polyline({{f.left, f.top}, {f.left, bottom}, {right, bottom}, {right, f.top}, {f.left, f.top}},
                  kGrey, 1);
  canvas.text({f.left + f.width / 2, bottom + 54}, chart.x_label, kTextPx, kInk, TextAnchor::kMiddle);
  canvas.text({26, f.top + f.height / 2}, chart.y_label, kTextPx, kInk, TextAnchor::kMiddle, true);
}

void draw_curve(Canvas& canvas, const Frame& f, const Chart& chart, const Curve& curve) {
  std::vector<Eigen::Vector2d> piece;
  const auto flush = [&] {
    canvas.polyline(piece, curve.color, curve.width_px, curve.dash_px);
    piece.clear();
  };
  for (const auto& p : curve.points) {
    if (!drawable(chart, p)) {
      flush();
      continue;
    }
    const Eigen::Vector2d at = f(p);
    // Steps far below a pixel add nothing but bytes.
    if (piece.empty() || (at - piece.back()).squaredNorm() > 0.04 || &p == &curve.points.back())
      piece.push_back(at);
    if (curve.marker_px > 0) canvas.disc(at, curve.marker_px, curve.color);
  }
  flush();
}

void draw_ends(Canvas& canvas, const Frame& f, const Chart& chart, const Curve& curve) {
  if (!curve.start_and_end || curve.points.empty()) return;
  const auto& a = curve.points.front();
  const auto& b = curve.points.back();
  if (!drawable(chart, a) || !drawable(chart, b)) return;
  canvas.disc(f(a), 9, kWhite);
  canvas.disc(f(a), 7.5, hex_color("009e73"));
  canvas.disc(f(a), 4, kWhite);
  canvas.disc(f(b), 8, kWhite);
  canvas.disc(f(b), 6.5, hex_color("c1272d"));
  const bool start_is_left = f(a).x() <= f(b).x();
  const auto label = [&](const Eigen::Vector2d& p, const std::string& text, bool left) {
    // On the side where the frame has room.
    if (f(p).x() - 70 < f.left) left = false;
    if (f(p).x() + 70 > f.left + f.width) left = true;
    canvas.text(f(p) + Eigen::Vector2d(left ? -14 : 14, -10), text, kTextPx, kInk,
                left ? TextAnchor::kEnd : TextAnchor::kStart);
  };
  label(a, "start", start_is_left);
  label(b, "end", !start_is_left);
}

}  // namespace

Color palette(std::size_t i) {
  static const std::array<const char*, 8> kColors{"0072b2", "d55e00", "009e73", "cc79a7",
                                                  "e69f00", "56b4e9", "8c6d1f", "000000"};
  return hex_color(kColors[i % kColors.size()]);
}

std::string draw_chart(const Chart& chart, ImageFormat format) {
  Eigen::Vector2d low, high;
  data_range(chart, low, high);
  const auto entries = legend(chart);
  Frame f;
  f.log_x = chart.log_x;
  f.left = kLeftPx;
  f.width = std::max(50.0, chart.width_px - kLeftPx - kRightPx);
  const double head = 22 + (chart.title.empty() ? 0 : 30) + (chart.subtitle.empty() ? 0 : 26);
  f.top = head + 26 * legend_rows(entries, f.left, 0, f.width, nullptr) + 6;
  f.height = std::max(50.0, chart.height_px - f.top - kBottomPx);
  if (chart.equal_aspect) {
    Eigen::Vector2d size = (high - low) * 1.08;
    size = size.cwiseMax(std::max(1e-3, 0.15 * size.maxCoeff()));
    const double height = std::clamp(f.width * size.y() / size.x(), 160.0, f.height);
    f.height = height;
    // Whichever side has room left shows more of the world.
    const double unit = std::max(size.x() / f.width, size.y() / f.height);
    size = {unit * f.width, unit * f.height};
    const Eigen::Vector2d center = 0.5 * (low + high);
    low = center - 0.5 * size;
    high = center + 0.5 * size;
  } else {
    const double margin = 0.05 * std::max(high.y() - low.y(), 1e-12);
    if (!(chart.y_from_zero && low.y() >= 0)) low.y() -= margin;
    high.y() += margin;
  }
  f.x = chart.log_x ? make_log_axis(low.x(), high.x())
                    : make_axis(low.x(), high.x(), static_cast<int>(f.width / 110));
  f.y = make_axis(low.y(), high.y(), std::max(2, static_cast<int>(f.height / 80)));

  const auto canvas =
      make_canvas(format, chart.width_px, static_cast<int>(f.top + f.height + kBottomPx), kWhite);
  if (!chart.title.empty()) canvas->text({f.left, 38}, chart.title, kTitlePx, kInk);
  if (!chart.subtitle.empty())
    canvas->text({f.left, chart.title.empty() ? 34.0 : 64.0}, chart.subtitle, kTextPx, kGrey);
  legend_rows(entries, f.left, head + 18, f.width, canvas.get());
  draw_axes(*canvas, f, chart);
  canvas->clip(f.left, f.top, f.width, f.height);
  for (const auto& links : chart.links) {
    for (const auto& line : links.lines) {
      if (drawable(chart, line.first) && drawable(chart, line.second)) {
        canvas->polyline({f(line.first), f(line.second)}, links.color, links.width_px);
      }
    }
  }
  for (const auto& curve : chart.curves) draw_curve(*canvas, f, chart, curve);
  canvas->clip(0, 0, 0, 0);
  for (const auto& curve : chart.curves) draw_ends(*canvas, f, chart, curve);
  return canvas->encode();
}

}  // namespace hp2
