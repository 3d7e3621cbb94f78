#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "common/drawing/canvas.hpp"
#include "viewer_headless/pictures/pictures.hpp"

namespace hp2 {

namespace {

constexpr int kShortestLongSidePx = 1000, kPreviewPx = 1400;
constexpr double kMostPixelsAVoxel = 5.0;
constexpr std::int64_t kSamplePoints = 200000;
const Color kBackground{13, 17, 23}, kText{220, 226, 232}, kPanel{13, 17, 23, 0.72}, kPath{255, 255, 255};

// The part of the world that the picture shows, and the heights that its colours span.
struct View {
  double left = -1, top = 1;  // [m], map frame: x of the left edge, y of the upper one
  double metre_px = 1;        // pixels a metre
  int width = 1, height = 1;
  double z_low = 0, z_high = 1;

  Eigen::Vector2d operator()(double x, double y) const {
    return {(x - left) * metre_px, (top - y) * metre_px};
  }
};

double quantile(std::vector<float>& values, double q) {
  if (values.empty()) return 0.0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// All of the trajectory and nearly all points: a few stray ones far out must not shrink the rest.
View choose_view(MapWriter& map, const SessionDigest& digest, double voxel_m, int long_side_px) {
  std::vector<float> x, y, z;
  const std::int64_t every = map.size() / kSamplePoints + 1;
  std::int64_t number = 0;
  map.for_each([&](const Eigen::Vector3f& p) {
    if (number++ % every != 0) return;
    x.push_back(p.x());
    y.push_back(p.y());
    z.push_back(p.z());
  });
  Eigen::Vector2d low(quantile(x, 0.003), quantile(y, 0.003)), high(quantile(x, 0.997), quantile(y, 0.997));
  for (const ScanRecord& scan : digest.scans) {
    low = low.cwiseMin(scan.map_from_sensor.translation.head<2>());
    high = high.cwiseMax(scan.map_from_sensor.translation.head<2>());
  }
  const double margin = 0.03 * (high - low).maxCoeff() + 2.0;
  low.array() -= margin;
  high.array() += margin;

  View view;
  const double extent = (high - low).maxCoeff();
  double side = long_side_px;
  if (voxel_m > 0)
    side =
        std::clamp(kMostPixelsAVoxel * extent / voxel_m, std::min(side, double(kShortestLongSidePx)), side);
  view.metre_px = side / extent;
  // Room for the legends on very long and narrow worlds.
  const Eigen::Vector2d size = ((high - low) * view.metre_px).cwiseMax(0.3 * side);
  const Eigen::Vector2d center = 0.5 * (low + high);
  view.width = static_cast<int>(std::lround(size.x()));
  view.height = static_cast<int>(std::lround(size.y()));
  view.left = center.x() - 0.5 * size.x() / view.metre_px;
  view.top = center.y() + 0.5 * size.y() / view.metre_px;
  view.z_low = quantile(z, 0.02);
  view.z_high = std::max(quantile(z, 0.98), view.z_low + 1.0);
  return view;
}

cv::Vec3b height_color(double share) {
  static const cv::Mat kTable = [] {
    cv::Mat grey(1, 256, CV_8U), table;
    for (int i = 0; i < 256; ++i) grey.at<uchar>(i) = static_cast<uchar>(i);
    cv::applyColorMap(grey, table, cv::COLORMAP_TURBO);
    return table;
  }();
  // Turbo's two ends are nearly black: they would vanish in the background.
  const double index = 18 + 222 * std::clamp(share, 0.0, 1.0);
  return kTable.at<cv::Vec3b>(static_cast<int>(index));
}

// Number of points and sum of their heights for every pixel.
struct Raster {
  cv::Mat weight, height;
};

Raster rasterize(MapWriter& map, const View& view, double voxel_m) {
  Raster out{cv::Mat::zeros(view.height, view.width, CV_32F),
             cv::Mat::zeros(view.height, view.width, CV_32F)};
  // As large as its voxel, but where one is many pixels wide, discs would hide what they show.
  const double radius = std::clamp(0.62 * voxel_m * view.metre_px, 0.5, 3.5);
  const int reach = static_cast<int>(std::ceil(radius));
  map.for_each([&](const Eigen::Vector3f& p) {
    const Eigen::Vector2d at = view(p.x(), p.y());
    if (at.x() < -reach || at.y() < -reach || at.x() > view.width + reach || at.y() > view.height + reach)
      return;
    const int column = static_cast<int>(std::floor(at.x())), row = static_cast<int>(std::floor(at.y()));
    const int first = std::max(0, column - reach), last = std::min(view.width - 1, column + reach);
    for (int r = std::max(0, row - reach); r <= std::min(view.height - 1, row + reach); ++r) {
      auto *weights = out.weight.ptr<float>(r), *heights = out.height.ptr<float>(r);
      const double dy = r + 0.5 - at.y();
      for (int c = first; c <= last; ++c) {
        const double dx = c + 0.5 - at.x();
        const auto w = static_cast<float>(std::clamp(radius + 0.5 - std::sqrt(dx * dx + dy * dy), 0.0, 1.0));
        weights[c] += w;
        heights[c] += w * p.z();
      }
    }
  });
  return out;
}

std::vector<unsigned char> colorize(const Raster& raster, const View& view) {
  std::vector<float> filled;
  for (int r = 0; r < view.height; ++r) {
    for (int c = 0; c < view.width; ++c) {
      if (raster.weight.at<float>(r, c) > 0.05F) filled.push_back(raster.weight.at<float>(r, c));
    }
  }
  const double bright = std::log1p(std::max(1.5, quantile(filled, 0.97)));
  const std::array<int, 3> background{kBackground.red, kBackground.green, kBackground.blue};
  std::vector<unsigned char> rgb(3 * static_cast<std::size_t>(view.width) * view.height);
  unsigned char* pixel = rgb.data();
  for (int r = 0; r < view.height; ++r) {
    const auto *weights = raster.weight.ptr<float>(r), *heights = raster.height.ptr<float>(r);
    for (int c = 0; c < view.width; ++c, pixel += 3) {
      const double w = weights[c];
      if (w <= 0) {  // most of them
        for (int k = 0; k < 3; ++k) pixel[k] = static_cast<unsigned char>(background[k]);
        continue;
      }
      const cv::Vec3b color = height_color((heights[c] / w - view.z_low) / (view.z_high - view.z_low));
      const double share = std::min(w, 1.0) * (0.30 + 0.70 * std::min(1.0, std::log1p(w) / bright));
      for (int k = 0; k < 3; ++k) {
        pixel[k] = cv::saturate_cast<uchar>(background[k] + share * (color[2 - k] - background[k]));
      }
    }
  }
  return rgb;
}

std::string metres(double value) {
  char text[32];
  std::snprintf(text, sizeof text, value >= 1000 ? "%.4g km" : "%g m", value >= 1000 ? value / 1000 : value);
  return text;
}

void draw_scale_bar(Canvas& canvas, const View& view, double unit) {
  double length = 1;  // the longest of 1, 2, 5, 10, ... m that takes at most a fifth of the width
  for (double power = 0.1; power < 1e6; power *= 10) {
    for (const double step : {1.0, 2.0, 5.0}) {
      if (step * power * view.metre_px <= 0.22 * view.width) length = step * power;
    }
  }
  const double px = length * view.metre_px, x = 26 * unit, y = view.height - 34 * unit;
  canvas.rectangle(x - 14 * unit, y - 40 * unit, px + 28 * unit, 60 * unit, kPanel);
  canvas.polyline({{x, y - 7 * unit}, {x, y}, {x + px, y}, {x + px, y - 7 * unit}}, kText, 2.5 * unit);
  canvas.text({x + px / 2, y - 14 * unit}, metres(length), 19 * unit, kText, TextAnchor::kMiddle);
}

void draw_height_legend(Canvas& canvas, const View& view, double unit) {
  const double w = 16 * unit, h = 170 * unit, x = view.width - 84 * unit, y = view.height - h - 34 * unit;
  canvas.rectangle(x - 18 * unit, y - 44 * unit, 92 * unit, h + 64 * unit, kPanel);
  for (int i = 0; i < 85; ++i) {
    const cv::Vec3b c = height_color(1.0 - i / 84.0);
    canvas.rectangle(x, y + i * h / 85, w, h / 85 + 0.5, {c[2], c[1], c[0]});
  }
  canvas.text({x - 8 * unit, y - 18 * unit}, "height", 17 * unit, kText);
  for (int i = 0; i <= 4; ++i) {
    char text[32];
    std::snprintf(text, sizeof text, "%.1f", view.z_high + (view.z_low - view.z_high) * i / 4);
    canvas.text({x + w + 8 * unit, y + h * i / 4 + 6 * unit}, text, 15 * unit, kText);
  }
}

void draw_path(Canvas& canvas, const View& view, const SessionDigest& digest, double unit) {
  std::vector<std::vector<Eigen::Vector2d>> pieces(1);  // of the path, without the gaps between them
  const std::vector<std::size_t> gaps = digest.gaps();
  for (std::size_t i = 0; i < digest.scans.size(); ++i) {
    if (std::binary_search(gaps.begin(), gaps.end(), i)) pieces.emplace_back();
    const auto& t = digest.scans[i].map_from_sensor.translation;
    if (t.allFinite()) pieces.back().push_back(view(t.x(), t.y()));
  }
  pieces.erase(std::remove_if(pieces.begin(), pieces.end(), [](const auto& piece) { return piece.empty(); }),
               pieces.end());
  for (const auto& piece : pieces) canvas.polyline(piece, {0, 0, 0, 0.55}, 5 * unit);
  for (const auto& piece : pieces) canvas.polyline(piece, kPath, 2.2 * unit);
  if (pieces.empty()) return;
  const Eigen::Vector2d start = pieces.front().front(), end = pieces.back().back();
  canvas.disc(start, 9 * unit, {0, 0, 0});
  canvas.disc(start, 7 * unit, hex_color("3fd08a"));
  canvas.disc(end, 9 * unit, {0, 0, 0});
  canvas.disc(end, 7 * unit, hex_color("ff5a5f"));
}

}  // namespace

std::string draw_map(MapWriter& map, const SessionDigest& digest, double voxel_m, int long_side_px,
                     std::string* preview) {
  const View view = choose_view(map, digest, voxel_m, long_side_px);
  const auto canvas =
      make_canvas_over(colorize(rasterize(map, view, voxel_m), view), view.width, view.height);
  const double unit = std::clamp(std::max(view.width, view.height) / 1500.0, 0.5, 2.0);
  draw_path(*canvas, view, digest, unit);
  draw_scale_bar(*canvas, view, unit);
  draw_height_legend(*canvas, view, unit);
  char text[160];
  std::snprintf(text, sizeof text, "%lld points, %.0f m driven; green: start, red: end",
                static_cast<long long>(map.size()), digest.path_m);
  canvas->rectangle(12 * unit, 12 * unit, 10.2 * unit * static_cast<double>(std::string(text).size()),
                    34 * unit, kPanel);
  canvas->text({24 * unit, 35 * unit}, text, 17 * unit, kText);
  if (preview != nullptr) *preview = canvas->preview(kPreviewPx);
  return canvas->encode();
}

}  // namespace hp2
