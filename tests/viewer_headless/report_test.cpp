// The report: its remarks, its thinned curves, and the page itself in headless Chromium.
#include "viewer_headless/report/report.hpp"

#include <cstdlib>
#include <sys/wait.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/viewer_headless/files.hpp"
#include "tests/viewer_headless/made_up_session.hpp"
#include "viewer_headless/report/assets.hpp"
#include "viewer_headless/summary.hpp"
#include "viewer_headless/write_session.hpp"

namespace hp2 {
namespace {

using testing::content;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

std::vector<Eigen::Vector3f> street(std::size_t i) {
  std::vector<Eigen::Vector3f> out;
  std::mt19937 rng(static_cast<unsigned>(i));
  std::uniform_real_distribution<float> u(-10.0F, 10.0F);
  for (int k = 0; k < 40; ++k) {
    out.emplace_back(u(rng), k % 2 == 0 ? 9.0F : -9.0F, 0.3F * std::abs(u(rng)));
    out.emplace_back(u(rng), u(rng), -1.8F);
  }
  return out;
}

testing::MadeUpSession session(double laps) {
  return testing::make_session(testing::block_drive(120, laps), street);
}

std::vector<std::string> remarks(const testing::MadeUpSession& s) {
  const SessionDigest digest = digest_session(s.view, {});
  std::vector<std::string> out;
  for (const auto& r : make_remarks(s.view, digest, make_summary(s.view, digest, std::nullopt, -1))) {
    EXPECT_FALSE(r.text.empty());
    out.push_back(r.text);
  }
  return out;
}

TEST(Remarks, SayWhatIsWrongAndNothingElse) {
  auto s = testing::make_session(testing::block_drive(80, 0.9), street);
  s.view.processes["hp2_backend"]["counters"]["closures_rejected"] = 9;  // as they should be
  EXPECT_TRUE(remarks(s).empty());
  s.view.graph.ended = false;
  s.view.scans_in += 2;
  s.view.warnings = {"the scans carry no time in the sweep: no deskew"};
  s.view.processes["hp2_backend"]["counters"]["rejected"] = 4;
  const auto found = remarks(s);
  EXPECT_EQ(found.size(), 4U);
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("2 scans that were played have no pose")));
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("not finished")));
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("hp2_backend rejected 4 messages")));
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("no deskew")));
}

TEST(Remarks, FindLostStretchesGapsAndUnclosedRevisits) {
  auto s = session(1.5);
  s.view.graph.closures.clear();
  const auto read = s.view.read_submap;
  s.view.read_submap = [read](std::int64_t id) {
    Submap submap = read(id);
    for (auto& scan : submap.scans) {
      if (id >= 2) scan.utime += 3000000;
    }
    submap.scans_skipped = id == 2 ? 29 : 0;
    return submap;
  };
  const auto found = remarks(s);
  EXPECT_THAT(found,
              ::testing::Contains(HasSubstr("There is 1 gap in the stream, of 3.10 s (usual: 0.100 s)")));
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("no loop closure was accepted")));
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("Tracking was lost")));
  EXPECT_THAT(found, ::testing::Contains(HasSubstr("29 scans were skipped")));
}

TEST(ReportData, DrawsNoLineAcrossAGap) {
  auto s = session(1.5);
  const auto read = s.view.read_submap;
  s.view.read_submap = [read](std::int64_t id) {
    Submap submap = read(id);
    for (auto& scan : submap.scans) scan.utime += id >= 2 ? 10'000'000 : 0;
    return submap;
  };
  const SessionDigest digest = digest_session(s.view, {});
  ASSERT_EQ(digest.gaps().size(), 1U);
  const auto data =
      report_data(s.view, digest, std::nullopt, make_summary(s.view, digest, std::nullopt, -1), 1000);
  EXPECT_EQ(data["gaps"], 1);
  for (const char* name : {"final", "odometry"}) {
    const auto& path = data["paths"][name];
    ASSERT_EQ(std::count_if(path.begin(), path.end(), [](const auto& p) { return p[0].is_null(); }), 1)
        << name;
    // Both ends of the gap are drawn.
    const auto at = std::find_if(path.begin(), path.end(), [](const auto& p) { return p[0].is_null(); });
    const std::size_t before = digest.gaps()[0] - 1;
    const auto& pose = std::string(name) == "final" ? digest.scans[before].map_from_sensor
                                                    : digest.scans[before].odom_from_sensor;
    EXPECT_NEAR((*std::prev(at))[0].get<double>(), pose.translation.x(),
                1e-3 * (1 + std::abs(pose.translation.x())));
  }
}

TEST(ReportData, ThinningKeepsEverySpikeAndTheSizeBounded) {
  auto s = testing::make_session(testing::block_drive(200, 10),
                                 [](std::size_t) { return std::vector<Eigen::Vector3f>(); });
  ASSERT_GT(s.truth.size(), 7900U);
  const auto read = s.view.read_submap;
  s.view.read_submap = [read](std::int64_t id) {
    Submap submap = read(id);
    for (auto& scan : submap.scans) {
      scan.diagnostics.sigma = scan.sequence == 4321 ? 9.0F : (scan.sequence == 5003 ? 0.001F : 0.5F);
    }
    return submap;
  };
  const SessionDigest digest = digest_session(s.view, {});
  const auto truth = compare_with_ground_truth(digest, s.view.ground_truth);
  const auto data = report_data(s.view, digest, truth, make_summary(s.view, digest, truth, -1), 1000);
  EXPECT_LE(data["sigma"].size(), 1000U);
  EXPECT_GE(data["sigma"].size(), 500U);
  double low = 1, high = 0, at = 0, before = -1;
  for (const auto& p : data["sigma"]) {
    EXPECT_GT(p[0].get<double>(), before);
    before = p[0];
    if (p[1].get<double>() > high) high = p[1], at = p[0];
    low = std::min(low, p[1].get<double>());
  }
  EXPECT_NEAR(high, 9.0, 1e-6);
  EXPECT_NEAR(at, 432.1, 1e-3);
  EXPECT_NEAR(low, 0.001, 1e-8);
  EXPECT_LT(report_html(data, "").size(), 1500000U);
}

// Runs Chromium on a page. Returns its DOM after the scripts; the log of the page's console in `console`.
std::string open_in_chromium(const std::string& page, const std::string& screenshot, const std::string& work,
                             std::string& console) {
  const std::string common =
      "timeout 120 chromium --headless --no-sandbox --disable-gpu --disable-quic --no-first-run "
      "--disable-background-networking --disable-component-update --disable-sync --hide-scrollbars "
      "--enable-logging=stderr --window-size=1300,5200 --virtual-time-budget=10000 --user-data-dir='" +
      work;
  const std::string url = " 'file://" + page + "' ";
  EXPECT_EQ(
      std::system(
          (common + "/profile_a' --dump-dom" + url + ">'" + work + "/dom' 2>'" + work + "/log_a'").c_str()),
      0);
  EXPECT_EQ(std::system((common + "/profile_b' --screenshot='" + screenshot + "'" + url + ">'" + work +
                         "/log_c' 2>'" + work + "/log_b'")
                            .c_str()),
            0);
  for (const char* log : {"/log_a", "/log_b"}) {
    std::istringstream lines(content(work + log));
    for (std::string line; std::getline(lines, line);) {
      if (line.find("CONSOLE") != std::string::npos) console += line + "\n";
    }
  }
  return content(work + "/dom");
}

TEST(Report, OpensFromDiskInABrowserWithoutAConsoleErrorAndZooms) {
  if (std::system("command -v chromium >/dev/null 2>&1") != 0) GTEST_SKIP() << "chromium is not installed";
  if (report_assets::chart_library().empty())
    GTEST_SKIP() << "built without libjs-chart.js: no charts to test";
  auto s = session(1.5);
  s.view.meta["data"] = "</script><script>document.body.dataset.broken='yes'</script><b>&amp;";
  s.view.scans_in += 3;
  const testing::TemporaryFolder folder;
  write_session(s.view, folder.path(), {});
  const std::string html = content(folder / "report.html");
  EXPECT_THAT(html, Not(HasSubstr("http-equiv=\"refresh\"")));
  EXPECT_LT(html.size(), 5000000U);

  // The page as it is, and once more with a finger on its charts: wheel and hover on each, then what they
  // show.
  const std::string probe = R"(<script>
    const out = [];
    for (const canvas of document.querySelectorAll('canvas')) {
      const chart = Chart.getChart(canvas), box = canvas.getBoundingClientRect(), x = chart.scales.x, before = x.max - x.min;
      const at = {clientX: box.left + x.left + 0.81 * (x.right - x.left), clientY: box.top + box.height / 2, bubbles: true, cancelable: true};
      canvas.dispatchEvent(new WheelEvent('wheel', {deltaY: -1200, ...at}));
      // All of a path is still there, however far it is zoomed in: its x does not rise.
      const whole = !canvas.parentNode.classList.contains('square') || chart.data.datasets.every((d, i) => {
        const c = chart.getDatasetMeta(i).controller;
        return d.showLine === false || c._drawCount === undefined || c._drawCount === d.data.length;
      });
      const zoomed = (chart.scales.x.max - chart.scales.x.min) / before;
      canvas.dispatchEvent(new MouseEvent('dblclick', at));
      const home = (chart.scales.x.max - chart.scales.x.min) / before;
      canvas.dispatchEvent(new MouseEvent('mousemove', at));
      out.push([zoomed.toFixed(3), home.toFixed(2), chart.data.datasets.some(d => d.data.length > 10), whole].join(' '));
    }
    document.body.dataset.charts = out.join(';');
  </script></body>)";
  std::string probed = html;
  probed.replace(probed.rfind("</body>"), 7, probe);
  std::ofstream(folder / "probed.html") << probed;

  // An error in a script is seen by what follows, or else the test could not fail.
  {
    std::string console;
    const testing::TemporaryFolder work;
    std::ofstream(folder / "broken.html") << "<script>nothing.there();</script>";
    open_in_chromium(folder / "broken.html", folder / "broken.png", work.path(), console);
    EXPECT_THAT(console, HasSubstr("nothing is not defined"));
  }

  const fs::path kept = fs::path(HP2_TEST_OUTPUT_DIR);
  fs::create_directories(kept);
  for (const bool with_probe : {false, true}) {
    std::string console;
    const testing::TemporaryFolder work;
    const std::string screenshot = kept / (with_probe ? "report_probed.png" : "report.png");
    fs::remove(screenshot);
    const std::string dom = open_in_chromium(folder / (with_probe ? "probed.html" : "report.html"),
                                             screenshot, work.path(), console);
    EXPECT_EQ(console, "");
    EXPECT_THAT(dom, HasSubstr("data-ready=\"yes\""));
    EXPECT_THAT(dom, Not(HasSubstr("data-broken")));
    EXPECT_THAT(dom, HasSubstr("3 scans that were played have no pose."));
    EXPECT_GT(fs::file_size(screenshot), 100000U);
    if (!with_probe) continue;
    const std::size_t from = dom.find("data-charts=\"");
    ASSERT_NE(from, std::string::npos);
    std::istringstream charts(dom.substr(from + 13, dom.find('"', from + 13) - from - 13));
    int n = 0;
    for (std::string chart; std::getline(charts, chart, ';'); ++n)
      EXPECT_EQ(chart, "0.166 1.00 true true") << "chart " << n;
    EXPECT_EQ(n, 8);
  }
}

}  // namespace
}  // namespace hp2
