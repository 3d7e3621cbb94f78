// Charts of curves over axes: trajectories seen from above, errors along the path, sensitivity curves.
#pragma once
#include <string>
#include <vector>

#include <Eigen/Core>

#include "common/drawing/canvas.hpp"

namespace hp2 {

/// One curve. Points that are not finite break the line.
struct Curve {
  std::string name;  ///< In the legend; empty: not there.
  Color color;
  std::vector<Eigen::Vector2d> points;
  double width_px = 2.0;
  double dash_px = 0.0;        ///< 0: a full line.
  double marker_px = 0.0;      ///< Radius of a dot at every point; 0: none.
  bool start_and_end = false;  ///< A ring at the first point, a full dot at the last.
};

/// Straight lines from point to point, all of one name: loop closures.
struct Links {
  std::string name;
  Color color;
  std::vector<std::pair<Eigen::Vector2d, Eigen::Vector2d>> lines;
  double width_px = 1.0;
};

/// A chart. Ranges are chosen from the data.
struct Chart {
  std::string title, subtitle;
  std::string x_label, y_label;
  bool equal_aspect = false;  ///< One unit is as long on both axes: maps.
  bool log_x = false;         ///< Logarithmic x axis; points of x <= 0 are left out.
  bool y_from_zero = false;
  std::vector<Links> links;  ///< Drawn below the curves.
  std::vector<Curve> curves;
  int width_px = 1200;
  int height_px = 900;  ///< For equal_aspect the largest height; the chart takes what the data need.
};

/// The i-th of 8 colours that people with any colour vision can tell apart (Okabe and Ito's).
Color palette(std::size_t i);

/// Draws the chart as a file's content.
std::string draw_chart(const Chart& chart, ImageFormat format);

/// Range and ticks of one axis, about `wanted` ticks at 1, 2 or 5 times a power of ten.
struct Axis {
  double low = 0, high = 1;
  std::vector<double> ticks;
  std::vector<std::string> labels;
};
Axis make_axis(double low, double high, int wanted);
/// Ticks at 1, 2 and 5 times the powers of ten; low and high > 0. The range is in log10.
Axis make_log_axis(double low, double high);

}  // namespace hp2
