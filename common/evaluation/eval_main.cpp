// hp2_eval: scores trajectories against a reference as evo_ape, evo_rpe and the KITTI devkit do.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <set>

#include <CLI/CLI.hpp>

#include "common/atomic_file.hpp"
#include "common/config.hpp"
#include "common/drawing/chart.hpp"
#include "common/error.hpp"
#include "common/evaluation/metrics.hpp"
#include "common/evaluation/score_table.hpp"
#include "common/program.hpp"

namespace {

using namespace hp2;

struct Options {
  std::string reference, align = "se3", json, csv, markdown, names;
  std::vector<std::string> estimates, plots, error_plots;
  AssociationOptions association;
  std::size_t rpe_delta = 1;
};

constexpr const char* kExamples = R"(Examples:
  hp2_eval poses.txt out/poses_kitti.txt
      KITTI files, one pose a scan: ATE after SE(3) alignment, RPE, KITTI drift
  hp2_eval --align none --json scores.json gt.tum est.tum
      TUM files, paired by time (at most --max-difference apart), no alignment
  hp2_eval gt.txt a.txt b.txt --names "before,after" --plot compare.png --markdown table.md
      several estimates side by side, drawn and as a table

A file has 12 numbers a line (KITTI: r11 r12 r13 tx ... tz) or 8 (TUM: t x y z qx qy qz qw); which one is recognised.
Exit status: 0 scored, 1 something is wrong with the input (said on stderr), 2 wrong use.)";

Options parse(int argc, char** argv, int& status) {
  Options o;
  CLI::App app{
      "hp2_eval: scores trajectories against a reference: ATE as evo_ape, RPE as evo_rpe, and the KITTI\n"
      "odometry metric (100..800 m) as the devkit."};
  app.name("hp2_eval");
  app.footer(kExamples);
  app.set_version_flag("--version", version());
  app.add_option("reference", o.reference, "Ground truth")->type_name("GT")->required();
  app.add_option("estimates", o.estimates, "One or more estimates")->type_name("EST")->required();
  app.add_option("--align", o.align,
                 "How the estimate is moved onto the reference for ATE: se3 (least squares over\n"
                 "all positions), origin (first pose on first pose), none")
      ->type_name("HOW")
      ->capture_default_str();
  app.add_option("--json", o.json, "Write all statistics as JSON")->type_name("FILE");
  app.add_option("--csv", o.csv, "Write the table as CSV")->type_name("FILE");
  app.add_option("--markdown", o.markdown, "Write the table as Markdown")->type_name("FILE");
  app.add_option("--plot", o.plots, "Draw the aligned trajectories; may be given again")
      ->type_name("FILE.png|.svg")
      ->take_all()
      ->expected(1);
  app.add_option("--plot-errors", o.error_plots,
                 "Draw the position errors along the reference's path; may be given again")
      ->type_name("FILE.png|.svg")
      ->take_all()
      ->expected(1);
  app.add_option("--names", o.names, "Names of the estimates, comma between, in place of their file names")
      ->type_name("A,B,...");
  app.add_option("--max-difference", o.association.max_difference_s,
                 "TUM: farthest apart that two times pair [s]")
      ->type_name("S")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  app.add_option("--offset", o.association.offset_s, "TUM: add this to the estimates' times [s]")
      ->type_name("S")
      ->capture_default_str();
  app.add_flag("--common-part", o.association.common_part,
               "KITTI: if the lengths differ, compare the first poses that both have");
  app.add_option("--rpe-delta", o.rpe_delta, "Poses between the two ends of a relative error")
      ->type_name("N")
      ->capture_default_str()
      ->check(CLI::PositiveNumber);
  try {
    app.parse(argc, argv);
    status = -1;
  } catch (const CLI::ParseError& e) {
    status = app.exit(e) == 0 ? 0 : 2;
  }
  return o;
}

// Shortest unambiguous names: the file's stem, or the path where two stems are the same.
std::vector<std::string> default_names(const std::vector<std::string>& paths) {
  std::map<std::string, int> uses;
  for (const auto& path : paths) ++uses[std::filesystem::path(path).stem().string()];
  std::vector<std::string> names;
  for (const auto& path : paths) {
    const std::string stem = std::filesystem::path(path).stem().string();
    names.push_back(uses[stem] == 1 ? stem : path);
  }
  return names;
}

// Axes (0, 1, 2 = x, y, z) of the plane that the reference covers most: x y for a LiDAR's frame, x z for a
// camera's.
std::pair<int, int> widest_plane(const Trajectory& reference) {
  Eigen::Vector3d low = reference.poses.front().topRightCorner<3, 1>(), high = low;
  for (const auto& pose : reference.poses) {
    low = low.cwiseMin(pose.topRightCorner<3, 1>());
    high = high.cwiseMax(pose.topRightCorner<3, 1>());
  }
  int thinnest = 0;
  (high - low).minCoeff(&thinnest);
  return {thinnest == 0 ? 1 : 0, thinnest == 2 ? 1 : 2};
}

Chart trajectory_chart(const Options& o, const Trajectory& reference,
                       const std::vector<NamedEvaluation>& results) {
  static const char* const kAxis[] = {"x [m]", "y [m]", "z [m]"};
  const auto [a, b] = widest_plane(reference);
  Chart chart;
  chart.title = "Trajectories";
  chart.subtitle = "alignment: " + o.align;
  chart.x_label = kAxis[a];
  chart.y_label = kAxis[b];
  chart.equal_aspect = true;
  const auto curve = [a = a, b = b](const std::string& name, const Trajectory& t, const Color& color) {
    Curve c;
    c.name = name;
    c.color = color;
    for (const auto& pose : t.poses) c.points.emplace_back(pose(a, 3), pose(b, 3));
    return c;
  };
  chart.curves.push_back(curve("reference", reference, {120, 126, 132}));
  chart.curves.back().width_px = 4;
  chart.curves.back().start_and_end = true;
  for (std::size_t i = 0; i < results.size(); ++i) {
    char text[32];
    std::snprintf(text, sizeof text, " (%.3f m)", results[i].evaluation.ate.rmse);
    chart.curves.push_back(curve(results[i].name + text, results[i].evaluation.aligned, palette(i)));
  }
  return chart;
}

Chart error_chart(const Options& o, const std::vector<NamedEvaluation>& results) {
  Chart chart;
  chart.title = "Absolute position error along the path";
  chart.subtitle = "alignment: " + o.align;
  chart.x_label = "path [m]";
  chart.y_label = "error [m]";
  chart.y_from_zero = true;
  chart.height_px = 600;
  for (std::size_t i = 0; i < results.size(); ++i) {
    const Evaluation& e = results[i].evaluation;
    char text[32];
    std::snprintf(text, sizeof text, " (RMSE %.3f m)", e.ate.rmse);
    Curve curve;
    curve.name = results[i].name + text;
    curve.color = palette(i);
    double path_m = 0.0;
    for (std::size_t k = 0; k < e.ate_errors.size(); ++k) {
      if (k > 0) {
        const auto step =
            e.reference.poses[k].topRightCorner<3, 1>() - e.reference.poses[k - 1].topRightCorner<3, 1>();
        path_m += step.norm();
      }
      curve.points.emplace_back(path_m, e.ate_errors[k]);
    }
    chart.curves.push_back(std::move(curve));
  }
  return chart;
}

int run(const Options& o) {
  const Alignment alignment = parse_alignment(o.align);
  for (const auto* plots : {&o.plots, &o.error_plots})
    for (const auto& plot : *plots) image_format(plot);  // before the work, not after it
  const auto names = o.names.empty() ? default_names(o.estimates) : CLI::detail::split(o.names, ',');
  if (names.size() != o.estimates.size()) {
    throw Error(
        std::to_string(names.size()) + " names for " + std::to_string(o.estimates.size()) + " estimates",
        "--names", "Give one name an estimate, with commas between.");
  }
  const Trajectory reference = read_trajectory(o.reference);
  std::vector<NamedEvaluation> results;
  for (std::size_t i = 0; i < o.estimates.size(); ++i) {
    const auto [a, b] =
        associate(reference, read_trajectory(o.estimates[i]), o.association, o.reference, o.estimates[i]);
    results.push_back({names[i], evaluate(a, b, alignment, o.rpe_delta)});
  }
  const Table table = score_table(results);
  std::fputs(format_text(table).c_str(), stdout);
  if (!o.csv.empty()) write_file(o.csv, format_csv(table));
  if (!o.markdown.empty()) write_file(o.markdown, format_markdown(table));
  if (!o.json.empty()) {
    nlohmann::ordered_json json;
    if (results.size() == 1) {
      json = to_json(results.front().evaluation);
    } else {
      for (const auto& r : results) {
        nlohmann::ordered_json one{{"name", r.name}};
        one.update(to_json(r.evaluation));
        json["estimates"].push_back(one);
      }
    }
    write_file(o.json, json.dump(2) + "\n");
  }
  for (const auto& plot : o.plots) {
    write_file(plot, draw_chart(trajectory_chart(o, reference, results), image_format(plot)));
  }
  for (const auto& plot : o.error_plots)
    write_file(plot, draw_chart(error_chart(o, results), image_format(plot)));
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return hp2::run_program("hp2_eval", [&] {
    int status = -1;
    const Options options = parse(argc, argv, status);
    return status >= 0 ? status : run(options);
  });
}
