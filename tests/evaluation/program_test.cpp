// hp2_eval as a user runs it, and the tables and pictures behind it.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sys/wait.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "common/atomic_file.hpp"
#include "common/drawing/chart.hpp"
#include "common/error.hpp"
#include "common/evaluation/score_table.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2 {
namespace {

using test::content;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Program : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::path(::testing::TempDir()) / ("hp2_eval_" + std::to_string(::getpid()) + "_" +
                                          ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
    std::vector<Pose> poses;
    for (int i = 0; i < 400; ++i) {
      poses.push_back(
          Pose(so3_exp({0, 0, 0.01 * i}), {100 * std::sin(0.01 * i), 100 - 100 * std::cos(0.01 * i), 0.0}));
    }
    write_trajectory(folder_ / "gt.txt", make_trajectory(poses), TrajectoryFormat::kKitti);
    for (auto& pose : poses) pose.translation.z() += pose.translation.x() > 0 ? 0.3 : -0.3;
    write_trajectory(folder_ / "a.txt", make_trajectory(poses), TrajectoryFormat::kKitti);
    poses.resize(300);
    write_trajectory(folder_ / "short.txt", make_trajectory(poses), TrajectoryFormat::kKitti);
  }
  void TearDown() override { fs::remove_all(folder_); }

  int run(const std::string& arguments) {
    const std::string command =
        "cd '" + folder_.string() + "' && '" HP2_EVAL "' " + arguments + " >out.log 2>err.log";
    const int status = std::system(command.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  fs::path folder_;
};

TEST_F(Program, OneEstimateGivesTheFixedShapeOfJson) {
  ASSERT_EQ(run("gt.txt a.txt --align none --json s.json"), 0) << content(folder_ / "err.log");
  const auto json = nlohmann::json::parse(content(folder_ / "s.json"));
  ASSERT_EQ(json.size(), 4U);
  for (const char* part : {"ate", "rpe_translation", "rpe_rotation_deg"}) {
    ASSERT_EQ(json[part].size(), 8U);
    for (const char* key : {"rmse", "mean", "median", "std", "min", "max", "sse", "n"}) {
      EXPECT_TRUE(json[part][key].is_number()) << part << "." << key;
    }
  }
  EXPECT_NEAR(json["ate"]["rmse"].get<double>(), 0.3, 1e-9);
  EXPECT_EQ(json["rpe_translation"]["n"], 399);
  EXPECT_GT(json["kitti"]["segments"].get<int>(), 50);
  EXPECT_TRUE(json["kitti"]["r_deg_per_100m"].is_number());
}

TEST_F(Program, SeveralEstimatesGiveATableAndPictures) {
  ASSERT_EQ(run("gt.txt a.txt gt.txt --names 'with error,perfect' --csv t.csv --markdown t.md --plot p.png "
                "--plot p.svg --plot-errors e.png --plot-errors e.svg "
                "--json s.json"),
            0)
      << content(folder_ / "err.log");
  EXPECT_THAT(content(folder_ / "out.log"), HasSubstr("with error"));
  EXPECT_THAT(content(folder_ / "t.csv"), HasSubstr("\nperfect,400,0.0000,"));
  EXPECT_THAT(content(folder_ / "t.md"), HasSubstr("| perfect | 400 | 0.0000 |"));
  EXPECT_THAT(content(folder_ / "p.svg"), HasSubstr("perfect (0.000 m)"));
  EXPECT_EQ(nlohmann::json::parse(content(folder_ / "s.json"))["estimates"].size(), 2U);
  EXPECT_EQ(cv::imread((folder_ / "p.png").string()).cols, 1200);
  EXPECT_THAT(content(folder_ / "e.svg"), HasSubstr("with error (RMSE "));
  EXPECT_THAT(content(folder_ / "e.svg"), HasSubstr("path [m]"));
  EXPECT_EQ(cv::imread((folder_ / "e.png").string()).rows, 600);
}

TEST_F(Program, SaysWhatIsWrong) {
  EXPECT_EQ(run("gt.txt short.txt"), 1);
  EXPECT_THAT(content(folder_ / "err.log"), HasSubstr("--common-part"));
  EXPECT_EQ(run("gt.txt short.txt --common-part"), 0);
  EXPECT_EQ(run("gt.txt nothing.txt"), 1);
  EXPECT_THAT(content(folder_ / "err.log"), HasSubstr("nothing.txt"));
  EXPECT_EQ(run("gt.txt a.txt --align sE3"), 1);
  EXPECT_EQ(run("gt.txt a.txt --plot p.gif"), 1);
  EXPECT_EQ(run("gt.txt a.txt --json missing/s.json"), 1);
  EXPECT_THAT(content(folder_ / "err.log"), HasSubstr("missing/s.json"));
  EXPECT_EQ(run("gt.txt"), 2);
  EXPECT_EQ(run("--help"), 0);
}

TEST(Table, SpecialCharactersAreQuoted) {
  const Table table{{"a", "b"}, {"x,\"y\"", "1|2"}};
  EXPECT_EQ(format_csv(table), "a,b\n\"x,\"\"y\"\"\",1|2\n");
  EXPECT_EQ(format_markdown(table), "| a | b |\n| --- | ---: |\n| x,\"y\" | 1\\|2 |\n");
  EXPECT_EQ(format_text({{"name", "n"}, {"a", "10"}}), "name   n\n----  --\na     10\n");
}

TEST(Chart, DrawsEachCurveWhereItsPointsAre) {
  Chart chart;
  chart.equal_aspect = true;
  chart.width_px = 600;
  chart.height_px = 600;
  chart.curves.push_back({"red", {255, 0, 0}, {{0, 0}, {100, 100}}, 4});
  chart.curves.push_back({"blue", {0, 0, 255}, {{0, 100}, {std::nan(""), 50}, {100, 100}}, 4});
  const std::string png = draw_chart(chart, ImageFormat::kPng);
  const cv::Mat image = cv::imdecode(std::vector<char>(png.begin(), png.end()), cv::IMREAD_COLOR);
  ASSERT_EQ(image.cols, 600);
  // In the frame (below the legend) red is a diagonal as wide as high; blue is broken by the gap: nothing.
  int left = 600, right = 0, top = 600, bottom = 0, blue = 0;
  for (int r = 80; r < image.rows; ++r) {
    for (int c = 0; c < image.cols; ++c) {
      const auto p = image.at<cv::Vec3b>(r, c);
      if (p[2] > 200 && p[1] < 60 && p[0] < 60) {
        left = std::min(left, c), right = std::max(right, c), top = std::min(top, r),
        bottom = std::max(bottom, r);
      }
      blue += p[0] > 200 && p[1] < 60 && p[2] < 60 ? 1 : 0;
    }
  }
  EXPECT_GT(right - left, 300);
  EXPECT_NEAR(right - left, bottom - top, 4);
  EXPECT_EQ(blue, 0);
  EXPECT_EQ(png, draw_chart(chart, ImageFormat::kPng));
}

TEST(Chart, AxesHaveRoundTicksInsideTheirRange) {
  const Axis a = make_axis(-13, 97, 5);
  EXPECT_EQ(a.labels, (std::vector<std::string>{"0", "50"}));
  EXPECT_EQ(make_axis(0, 1, 5).labels, (std::vector<std::string>{"0.0", "0.2", "0.4", "0.6", "0.8", "1.0"}));
  EXPECT_EQ(make_axis(5, 5, 3).low, 4.5);
  EXPECT_EQ(make_log_axis(0.005, 0.3).labels,
            (std::vector<std::string>{"0.005", "0.01", "0.02", "0.05", "0.1", "0.2"}));
}

TEST(AtomicFile, LeavesTheOldFileUntilCommitAndNothingElseBehind) {
  const fs::path folder = fs::path(::testing::TempDir()) / ("atomic_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  const std::string path = folder / "f.txt";
  write_file(path, "old");
  {
    AtomicFile file(path);
    file.write("new");
    EXPECT_EQ(content(path), "old");
    // Where the file system can, a process that is killed now leaves nothing behind.
    const bool unnamed = file.temporary_path().rfind("/proc/", 0) == 0;
    EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), unnamed ? 1 : 2);
  }
  EXPECT_EQ(content(path), "old");
  {
    AtomicFile file(path);
    file.write("count ??; rest");
    file.patch(6, "42");
    file.write("!");
    file.commit();
  }
  EXPECT_EQ(content(path), "count 42; rest!");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1);
  EXPECT_THROW(write_file(folder / "no/f.txt", "x"), Error);
  fs::remove_all(folder);
}

TEST(AtomicFile, AFullDiskIsAnErrorThatNamesTheFile) {
  // A file system of 64 kB, where one can be mounted.
  const fs::path folder = fs::path(::testing::TempDir()) / ("full_" + std::to_string(::getpid()));
  fs::create_directories(folder);
  if (std::system(("mount -t tmpfs -o size=64k tmpfs '" + folder.string() + "' 2>/dev/null").c_str()) != 0) {
    fs::remove_all(folder);
    GTEST_SKIP() << "no right to mount a small file system";
  }
  std::string message;
  try {
    write_file(folder / "big.bin", std::string(1 << 20, 'x'));
  } catch (const Error& e) {
    message = e.what();
  }
  const auto left = std::distance(fs::directory_iterator(folder), fs::directory_iterator());
  EXPECT_EQ(std::system(("umount '" + folder.string() + "'").c_str()), 0);
  fs::remove_all(folder);
  EXPECT_THAT(message, HasSubstr("big.bin"));
  EXPECT_THAT(message, HasSubstr("Free some space"));
  EXPECT_EQ(left, 0);
}

}  // namespace
}  // namespace hp2
