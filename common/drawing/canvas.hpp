// A surface to draw on, the same calls for a PNG and an SVG.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace hp2 {

/// A colour, each part 0..255; `alpha` 0..1.
struct Color {
  int red = 0, green = 0, blue = 0;
  double alpha = 1.0;
};

/// "0072b2" or "#0072b2" as a colour.
Color hex_color(const std::string& hex);

enum class ImageFormat { kPng, kSvg };
/// By the end of a file's name, .png or .svg. @throws Error for any other
ImageFormat image_format(const std::string& path);

enum class TextAnchor { kStart, kMiddle, kEnd };

/// Coordinates in pixels, x to the right, y down, (0, 0) the upper left corner. What lies outside is cut off.
class Canvas {
 public:
  virtual ~Canvas() = default;
  int width() const { return width_; }
  int height() const { return height_; }

  virtual void rectangle(double x, double y, double w, double h, const Color& fill) = 0;
  /// Line through all points; `dash` > 0: dashes and gaps of so many pixels.
  virtual void polyline(const std::vector<Eigen::Vector2d>& points, const Color& color, double width,
                        double dash = 0.0) = 0;
  virtual void disc(const Eigen::Vector2d& center, double radius, const Color& fill) = 0;
  /// Text with its base line at `at`; `size` is its height [px]. ASCII only. `upright`: read from below.
  virtual void text(const Eigen::Vector2d& at, const std::string& text, double size, const Color& color,
                    TextAnchor anchor = TextAnchor::kStart, bool upright = false) = 0;
  /// All drawing after it is cut to this rectangle; of no width: to the whole canvas.
  virtual void clip(double x, double y, double w, double h) = 0;
  /// The picture as a file's content.
  virtual std::string encode() = 0;
  /// The same as a JPEG, at most so large; empty if it is no picture of pixels.
  virtual std::string preview(int /*long_side_px*/) { return {}; }

 protected:
  Canvas(int width, int height) : width_(width), height_(height) {}

 private:
  int width_, height_;
};

/// An empty canvas of a background colour. Sides from 1 to 20,000 px.
std::unique_ptr<Canvas> make_canvas(ImageFormat format, int width, int height, const Color& background);

/// A PNG canvas whose background is a picture, `rgb` holding width * height * 3 bytes row by row.
std::unique_ptr<Canvas> make_canvas_over(const std::vector<unsigned char>& rgb, int width, int height);

}  // namespace hp2
