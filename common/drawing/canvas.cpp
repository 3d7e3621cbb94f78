#include "common/drawing/canvas.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "common/error.hpp"

namespace hp2 {

namespace {

// Drawn at twice the size and averaged: OpenCV's own anti-aliasing knows neither half-transparent nor thin
// lines.
constexpr int kScale = 2;
constexpr int kJpegQuality = 86;
constexpr int kShift = 4;  // fractional bits of OpenCV's fixed-point coordinates

cv::Scalar bgr(const Color& c) { return {double(c.blue), double(c.green), double(c.red)}; }

class PngCanvas : public Canvas {
 public:
  PngCanvas(int width, int height, const Color& background)
      : Canvas(width, height), image_(height * kScale, width * kScale, CV_8UC3, bgr(background)) {
    PngCanvas::clip(0, 0, 0, 0);
  }

  void cover_with(const cv::Mat& picture) {
    cv::resize(picture, image_, image_.size(), 0, 0, cv::INTER_NEAREST);
  }

  void rectangle(double x, double y, double w, double h, const Color& fill) override {
    const cv::Rect box(px(x), px(y), std::max(1, px(w)), std::max(1, px(h)));
    blended(fill, box, [&](cv::Mat& image, const cv::Point& o) {
      cv::rectangle(image, box - o, bgr(fill), cv::FILLED);
    });
  }

  void polyline(const std::vector<Eigen::Vector2d>& points, const Color& color, double width,
                double dash) override {
    if (points.size() < 2) return;
    cv::Rect box = bounds(points, width);
    blended(color, box, [&](cv::Mat& image, const cv::Point& o) {
      const int thickness = std::max(1, static_cast<int>(std::lround(width * kScale)));
      for (const auto& piece :
           dash > 0 ? dashes(points, dash) : std::vector<std::vector<Eigen::Vector2d>>{points}) {
        std::vector<cv::Point> fixed;
        for (const auto& p : piece) fixed.push_back(fixed_point(p, o));
        cv::polylines(image, fixed, false, bgr(color), thickness, cv::LINE_AA, kShift);
      }
    });
  }

  void disc(const Eigen::Vector2d& center, double radius, const Color& fill) override {
    const cv::Rect box = bounds({center}, 2 * radius);
    blended(fill, box, [&](cv::Mat& image, const cv::Point& o) {
      cv::circle(image, fixed_point(center, o),
                 static_cast<int>(std::lround(radius * kScale * (1 << kShift))), bgr(fill), cv::FILLED,
                 cv::LINE_AA, kShift);
    });
  }

  void text(const Eigen::Vector2d& at, const std::string& text, double size, const Color& color,
            TextAnchor anchor, bool upright) override {
    constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;
    const double scale = size * kScale / 30.0;  // a capital of this font is 21 units high, its line 30
    const int thickness = std::max(1, static_cast<int>(std::lround(scale * 1.6)));
    int base = 0;
    const cv::Size extent = cv::getTextSize(text, kFont, scale, thickness, &base);
    base += thickness;
    // Drawn as a mask of its own, so that it can be turned.
    cv::Mat mask(extent.height + 2 * base, extent.width + 2 * base, CV_8U, cv::Scalar(0));
    cv::putText(mask, text, {base, extent.height + base}, kFont, scale, {255}, thickness, cv::LINE_AA);
    const double back = anchor == TextAnchor::kStart ? 0.0 : (anchor == TextAnchor::kMiddle ? 0.5 : 1.0);
    const int along = static_cast<int>(back * extent.width) + base;
    cv::Point corner(px(at.x()) - along, px(at.y()) - extent.height - base);
    if (upright) {
      cv::rotate(mask, mask, cv::ROTATE_90_COUNTERCLOCKWISE);
      corner = {px(at.x()) - extent.height - base, px(at.y()) - (mask.rows - along)};
    }
    const cv::Rect box = cv::Rect(corner, mask.size()) & clip_;
    if (box.empty()) return;
    cv::Mat target = image_(box);
    const cv::Mat part = mask(box - corner);
    for (int r = 0; r < box.height; ++r) {
      for (int c = 0; c < box.width; ++c) {
        const double a = color.alpha * part.at<uchar>(r, c) / 255.0;
        for (int k = 0; k < 3; ++k) {
          uchar& v = target.at<cv::Vec3b>(r, c)[k];
          v = cv::saturate_cast<uchar>(v + a * (bgr(color)[k] - v));
        }
      }
    }
  }

  void clip(double x, double y, double w, double h) override {
    const cv::Rect whole(0, 0, image_.cols, image_.rows);
    clip_ = w <= 0 ? whole : cv::Rect(px(x), px(y), px(w), px(h)) & whole;
  }

  std::string encode() override {
    cv::Mat out;
    cv::resize(image_, out, {width(), height()}, 0, 0, cv::INTER_AREA);
    std::vector<uchar> bytes;
    cv::imencode(".png", out, bytes, {cv::IMWRITE_PNG_COMPRESSION, 6});
    return {bytes.begin(), bytes.end()};
  }

  std::string preview(int long_side_px) override {
    const double scale = std::min(1.0, static_cast<double>(long_side_px) / std::max(width(), height()));
    cv::Mat out;
    cv::resize(image_, out, {}, scale / kScale, scale / kScale, cv::INTER_AREA);
    std::vector<uchar> bytes;
    cv::imencode(".jpg", out, bytes, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
    return {bytes.begin(), bytes.end()};
  }

 private:
  // Far outside is still inside OpenCV's fixed-point numbers.
  static int px(double v) { return static_cast<int>(std::lround(std::clamp(v, -1e6, 1e6) * kScale)); }
  static cv::Point fixed_point(const Eigen::Vector2d& p, const cv::Point& o) {
    const auto f = [](double v, int origin) {
      return static_cast<int>(std::lround((std::clamp(v, -3e4, 3e4) * kScale - origin) * (1 << kShift)));
    };
    return {f(p.x(), o.x), f(p.y(), o.y)};
  }

  static cv::Rect bounds(const std::vector<Eigen::Vector2d>& points, double width) {
    Eigen::Vector2d low = points.front(), high = points.front();
    for (const auto& p : points) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const int margin = px(width) + 4;
    const cv::Point a(px(low.x()) - margin, px(low.y()) - margin);
    return {a, cv::Point(px(high.x()) + margin, px(high.y()) + margin)};
  }

  static std::vector<std::vector<Eigen::Vector2d>> dashes(const std::vector<Eigen::Vector2d>& points,
                                                          double dash) {
    std::vector<std::vector<Eigen::Vector2d>> out{{points.front()}};
    double left = dash;
    bool on = true;
    for (std::size_t i = 1; i < points.size(); ++i) {
      Eigen::Vector2d from = points[i - 1];
      double length = (points[i] - from).norm();
      while (length > left) {
        from += (points[i] - from) * (left / length);
        length -= left;
        left = dash;
        if (on) out.back().push_back(from);
        on = !on;
        if (on) out.push_back({from});
      }
      left -= length;
      if (on) out.back().push_back(points[i]);
    }
    return out;
  }

  // Draws into the clipped part of `box`, mixed with what is there if the colour is not opaque.
  template <typename Draw>
  void blended(const Color& color, const cv::Rect& box, const Draw& draw) {
    const cv::Rect part = box & clip_;
    if (part.empty()) return;
    cv::Mat target = image_(part);
    if (color.alpha >= 1.0) {
      draw(target, part.tl());
      return;
    }
    cv::Mat drawn = target.clone();
    draw(drawn, part.tl());
    cv::addWeighted(drawn, color.alpha, target, 1.0 - color.alpha, 0.0, target);
  }

  cv::Mat image_;
  cv::Rect clip_;
};

class SvgCanvas : public Canvas {
 public:
  SvgCanvas(int width, int height, const Color& background) : Canvas(width, height) {
    rectangle(0, 0, width, height, background);
  }

  void rectangle(double x, double y, double w, double h, const Color& fill) override {
    body_ += "<rect x=\"" + num(x) + "\" y=\"" + num(y) + "\" width=\"" + num(w) + "\" height=\"" + num(h) +
             "\"" + paint("fill", fill) + "/>\n";
  }
  void polyline(const std::vector<Eigen::Vector2d>& points, const Color& color, double width,
                double dash) override {
    if (points.size() < 2) return;
    body_ += "<polyline fill=\"none\" stroke-linejoin=\"round\"" + paint("stroke", color) +
             " stroke-width=\"" + num(width) + "\"";
    if (dash > 0) body_ += " stroke-dasharray=\"" + num(dash) + "\"";
    body_ += " points=\"";
    for (const auto& p : points) body_ += num(p.x()) + "," + num(p.y()) + " ";
    body_ += "\"/>\n";
  }
  void disc(const Eigen::Vector2d& center, double radius, const Color& fill) override {
    body_ += "<circle cx=\"" + num(center.x()) + "\" cy=\"" + num(center.y()) + "\" r=\"" + num(radius) +
             "\"" + paint("fill", fill) + "/>\n";
  }
  void text(const Eigen::Vector2d& at, const std::string& text, double size, const Color& color,
            TextAnchor anchor, bool upright) override {
    static const char* const kAnchors[] = {"start", "middle", "end"};
    const std::string place = num(at.x()) + " " + num(at.y());
    body_ += "<text transform=\"translate(" + place + ")" + (upright ? " rotate(-90)" : "") +
             "\" font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\" font-size=\"" + num(size * 0.95) +
             "\" text-anchor=\"" + kAnchors[static_cast<int>(anchor)] + "\"" + paint("fill", color) + ">";
    for (const char c : text) {
      if (c == '<')
        body_ += "&lt;";
      else if (c == '>')
        body_ += "&gt;";
      else if (c == '&')
        body_ += "&amp;";
      else if (static_cast<unsigned char>(c) >= 0x20)
        body_ += c;
    }
    body_ += "</text>\n";
  }
  void clip(double x, double y, double w, double h) override {
    if (clipped_) body_ += "</g>\n";
    clipped_ = w > 0;
    if (!clipped_) return;
    const std::string id = "clip" + std::to_string(++clips_);
    body_ += "<clipPath id=\"" + id + "\"><rect x=\"" + num(x) + "\" y=\"" + num(y) + "\" width=\"" + num(w) +
             "\" height=\"" + num(h) + "\"/></clipPath>\n<g clip-path=\"url(#" + id + ")\">\n";
  }
  std::string encode() override {
    clip(0, 0, 0, 0);
    const std::string size = num(width()) + " " + num(height());
    return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" "
           "viewBox=\"0 0 " +
           size + "\" width=\"" + num(width()) + "\" height=\"" + num(height()) + "\">\n" + body_ +
           "</svg>\n";
  }

 private:
  static std::string num(double v) {
    char buffer[32];
    std::snprintf(buffer, sizeof buffer, "%.8g", std::round(v * 100.0) / 100.0);
    return buffer;
  }
  static std::string paint(const std::string& what, const Color& c) {
    std::string out = " " + what + "=\"rgb(" + std::to_string(c.red) + "," + std::to_string(c.green) + "," +
                      std::to_string(c.blue) + ")\"";
    if (c.alpha < 1.0) out += " " + what + "-opacity=\"" + num(c.alpha) + "\"";
    return out;
  }

  std::string body_;
  bool clipped_ = false;
  int clips_ = 0;
};

}  // namespace

Color hex_color(const std::string& hex) {
  const std::string digits = hex.substr(hex.find_first_not_of('#'));
  const unsigned long v = std::stoul(digits, nullptr, 16);
  return {static_cast<int>(v >> 16 & 255), static_cast<int>(v >> 8 & 255), static_cast<int>(v & 255)};
}

ImageFormat image_format(const std::string& path) {
  const auto ends = [&](const std::string& end) {
    return path.size() >= end.size() && path.compare(path.size() - end.size(), end.size(), end) == 0;
  };
  if (ends(".png")) return ImageFormat::kPng;
  if (ends(".svg")) return ImageFormat::kSvg;
  throw Error("unknown picture format", path, "End the name with .png or .svg.");
}

std::unique_ptr<Canvas> make_canvas(ImageFormat format, int width, int height, const Color& background) {
  width = std::clamp(width, 1, 20000);
  height = std::clamp(height, 1, 20000);
  if (format == ImageFormat::kSvg) return std::make_unique<SvgCanvas>(width, height, background);
  return std::make_unique<PngCanvas>(width, height, background);
}

std::unique_ptr<Canvas> make_canvas_over(const std::vector<unsigned char>& rgb, int width, int height) {
  auto canvas = std::make_unique<PngCanvas>(width, height, Color{});
  cv::Mat picture(height, width, CV_8UC3);
  for (int r = 0; r < height; ++r) {
    for (int c = 0; c < width; ++c) {
      const unsigned char* p = &rgb[3 * (static_cast<std::size_t>(r) * width + c)];
      picture.at<cv::Vec3b>(r, c) = {p[2], p[1], p[0]};
    }
  }
  canvas->cover_with(picture);
  return canvas;
}

}  // namespace hp2
