// hp2_chart: draws a chart that a JSON file describes, as PNG and SVG. For scripts.
#include <fstream>
#include <limits>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "common/atomic_file.hpp"
#include "common/drawing/chart.hpp"
#include "common/error.hpp"
#include "common/program.hpp"

namespace {

using namespace hp2;
using Json = nlohmann::json;

constexpr const char* kFormat =
    R"(The JSON file: {"title", "subtitle", "x_label", "y_label", "log_x", "y_from_zero", "equal_aspect",
 "width_px", "height_px", "curves": [{"name", "color": "0072b2", "points": [[x, y], ...], "width_px", "dash_px",
 "marker_px"}]}. Only curves and their points are needed; a coordinate that is null breaks the line.
Example: hp2_chart chart.json chart.png chart.svg)";

double coordinate(const Json& value) {
  return value.is_null() ? std::numeric_limits<double>::quiet_NaN() : value.get<double>();
}

Curve parse_curve(const Json& json, std::size_t index) {
  Curve curve;
  curve.name = json.value("name", "");
  curve.color = json.contains("color") ? hex_color(json["color"].get<std::string>()) : palette(index);
  curve.width_px = json.value("width_px", curve.width_px);
  curve.dash_px = json.value("dash_px", curve.dash_px);
  curve.marker_px = json.value("marker_px", curve.marker_px);
  for (const Json& point : json.at("points"))
    curve.points.emplace_back(coordinate(point.at(0)), coordinate(point.at(1)));
  return curve;
}

Chart parse_chart(const std::string& path) {
  std::ifstream file(path);
  if (!file)
    throw Error("the chart's description cannot be read", path, "Check the name and the permissions.");
  try {
    const Json json = Json::parse(file);
    Chart chart;
    chart.title = json.value("title", "");
    chart.subtitle = json.value("subtitle", "");
    chart.x_label = json.value("x_label", "");
    chart.y_label = json.value("y_label", "");
    chart.log_x = json.value("log_x", false);
    chart.y_from_zero = json.value("y_from_zero", false);
    chart.equal_aspect = json.value("equal_aspect", false);
    chart.width_px = std::clamp(json.value("width_px", chart.width_px), 200, 10000);
    chart.height_px = std::clamp(json.value("height_px", chart.height_px), 200, 10000);
    for (const Json& curve : json.at("curves"))
      chart.curves.push_back(parse_curve(curve, chart.curves.size()));
    return chart;
  } catch (const Json::exception& e) {
    throw Error(std::string("the chart's description is not understood: ") + e.what(), path,
                "hp2_chart --help says what it holds.");
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Draws a chart that a JSON file describes.", "hp2_chart");
  std::string description;
  std::vector<std::string> pictures;
  app.add_option("description", description, "JSON file")->type_name("FILE.json")->required();
  app.add_option("pictures", pictures, "Files to write")->type_name("FILE.png|.svg")->required();
  app.footer(kFormat);
  app.set_version_flag("--version", hp2::version());
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_chart", [&] {
    for (const auto& picture : pictures) hp2::image_format(picture);
    const hp2::Chart chart = parse_chart(description);
    for (const auto& picture : pictures)
      hp2::write_file(picture, hp2::draw_chart(chart, hp2::image_format(picture)));
    return 0;
  });
}
