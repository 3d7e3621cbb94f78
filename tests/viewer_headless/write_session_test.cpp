#include "viewer_headless/write_session.hpp"

#include <cstring>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "common/error.hpp"
#include "common/evaluation/trajectory.hpp"
#include "tests/viewer_headless/files.hpp"
#include "tests/viewer_headless/made_up_session.hpp"
#include "viewer_headless/map/map_writer.hpp"

namespace hp2 {
namespace {

using testing::content;
using ::testing::HasSubstr;
using testing::TemporaryFolder;
namespace fs = std::filesystem;

// Landmarks around the block, in the middle of voxels of 0.5 m: posts of 10 points.
std::vector<Eigen::Vector3d> landmarks(double side) {
  std::vector<Eigen::Vector3d> out;
  for (double s = -20.25; s < side + 20; s += 4) {
    for (const auto& at : {Eigen::Vector2d(s, -10.25), Eigen::Vector2d(s, side + 10.25),
                           Eigen::Vector2d(-15.25, s), Eigen::Vector2d(side + 15.25, s)}) {
      for (int k = 0; k < 10; ++k) {
        out.emplace_back(std::floor(at.x() * 2) / 2 + 0.25, std::floor(at.y() * 2) / 2 + 0.25,
                         0.25 + 0.5 * k);
      }
    }
  }
  return out;
}

constexpr double kSide = 80;

testing::MadeUpSession block_session(const Pose& world_from_map = Pose()) {
  const auto truth = testing::block_drive(kSide, 1.6);
  const auto points = [truth, marks = landmarks(kSide)](std::size_t i) {
    std::vector<Eigen::Vector3f> seen;
    for (const auto& mark : marks) {
      const Eigen::Vector3d p = truth[i].inverse() * mark;
      if (p.norm() < 30) seen.push_back(p.cast<float>());
    }
    return seen;
  };
  testing::MadeUpOptions options;
  options.scans_a_submap = 40;
  return testing::make_session(truth, points, options, world_from_map);
}

std::vector<Eigen::Vector3f> read_points(const std::string& path, const std::string& count_key,
                                         const std::string& end) {
  const std::string bytes = content(path);
  const std::size_t key = bytes.find("\n" + count_key + " ") + 1;
  const std::size_t count = std::stoul(bytes.substr(key + count_key.size() + 1));
  const std::size_t body = bytes.find("\n" + end + "\n") + end.size() + 2;
  EXPECT_EQ(bytes.size() - body, count * 12) << path;
  std::vector<Eigen::Vector3f> points((bytes.size() - body) / 12);
  if (points.empty()) return points;
  std::memcpy(points.front().data(), bytes.data() + body, points.size() * 12);
  return points;
}

TEST(WriteSession, TheMapLiesWhereTheCorrectedPosesPutIt) {
  const auto session = block_session();
  const TemporaryFolder folder;
  write_session(session.view, folder.path(), {});
  const auto marks = landmarks(kSide);
  std::set<std::array<int, 3>> seen_marks;
  const auto ply = read_points(folder / "map.ply", "element vertex", "end_header");
  const auto pcd = read_points(folder / "map.pcd", "POINTS", "DATA binary");
  ASSERT_EQ(ply.size(), pcd.size());
  EXPECT_THAT(content(folder / "map.pcd"), HasSubstr("\nWIDTH " + std::to_string(ply.size()) + "\n"));
  for (std::size_t i = 0; i < ply.size(); ++i) {
    EXPECT_EQ(ply[i], pcd[i]);
    double nearest = 1e9;
    for (const auto& mark : marks) nearest = std::min(nearest, (mark - ply[i].cast<double>()).norm());
    ASSERT_LT(nearest, 1e-3);
    // One point a voxel: no landmark twice.
    const Eigen::Vector3f cell = (ply[i] * 2).array().floor();
    EXPECT_TRUE(seen_marks.insert({int(cell.x()), int(cell.y()), int(cell.z())}).second);
  }
  EXPECT_GT(ply.size(), 600U);
}

TEST(WriteSession, PosesAreTheSessionsAndOnlyTheKnownFilesAreThere) {
  const auto session = block_session();
  const TemporaryFolder folder;
  const auto names = write_session(session.view, folder / "new/out", {});
  const std::set<std::string> expected{
      "poses_kitti.txt",        "poses_tum.txt",   "poses_odometry_kitti.txt",
      "poses_odometry_tum.txt", "map.ply",         "map.pcd",
      "trajectory.png",         "map_topdown.png", "graph.g2o",
      "closures.csv",           "summary.json",    "report.html"};
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()), expected);
  std::set<std::string> there;
  for (const auto& entry : fs::directory_iterator(folder / "new/out")) there.insert(entry.path().filename());
  EXPECT_EQ(there, expected);

  const Trajectory kitti = read_trajectory(folder / "new/out/poses_kitti.txt");
  const Trajectory tum = read_trajectory(folder / "new/out/poses_tum.txt");
  const Trajectory odometry = read_trajectory(folder / "new/out/poses_odometry_kitti.txt");
  ASSERT_EQ(kitti.size(), session.truth.size());
  ASSERT_EQ(tum.size(), session.truth.size());
  ASSERT_EQ(odometry.size(), session.truth.size());
  for (std::size_t i = 0; i < kitti.size(); ++i) {
    EXPECT_LT((kitti.poses[i].topRows<3>() - session.truth[i].matrix()).norm(), 1e-8);
    EXPECT_LT((tum.poses[i] - kitti.poses[i]).norm(), 1e-8);
    EXPECT_NEAR(tum.times_s[i], 1700000000.0 + 0.1 * double(i + 1), 1e-5);
    EXPECT_LT(
        (odometry.poses[i].topRows<3>() - session.view.graph.trajectory[i].odom_from_sensor.matrix()).norm(),
        1e-7);
  }
}

TEST(WriteSession, TheSameViewGivesTheSameBytes) {
  const auto session = block_session();
  const TemporaryFolder a, b;
  const auto names = write_session(session.view, a.path(), {});
  write_session(session.view, b.path(), {});
  write_session(session.view, b.path(), {});  // over the files of the run before
  for (const auto& name : names) EXPECT_TRUE(content(a / name) == content(b / name)) << name;
}

TEST(WriteSession, PicturesShowSomething) {
  const auto session = block_session();
  const TemporaryFolder folder;
  ViewerConfig config;
  config.picture_size_px = 900;
  write_session(session.view, folder.path(), config);
  const cv::Mat map = cv::imread(folder / "map_topdown.png"), path = cv::imread(folder / "trajectory.png");
  EXPECT_EQ(std::max(map.cols, map.rows), 900);
  EXPECT_EQ(path.cols, 900);
  int colourful = 0, dark = 0, white = 0, blue = 0, orange = 0;
  for (int r = 0; r < map.rows; ++r) {
    for (int c = 0; c < map.cols; ++c) {
      const auto p = map.at<cv::Vec3b>(r, c);
      const int high = std::max({p[0], p[1], p[2]}), low = std::min({p[0], p[1], p[2]});
      colourful += high - low > 80;
      dark += high < 40;
      white += low > 230;
    }
  }
  for (int r = 110; r < path.rows; ++r) {  // below the legend
    for (int c = 0; c < path.cols; ++c) {
      const auto p = path.at<cv::Vec3b>(r, c);
      blue += p[0] > 150 && p[2] < 40;
      orange += p[2] > 200 && p[0] < 60 && p[1] > 100;
    }
  }
  EXPECT_GT(colourful, 3000);
  EXPECT_GT(dark, map.rows * map.cols / 2);
  EXPECT_GT(white, 500);   // the trajectory, 320 m of a picture 115 m wide
  EXPECT_GT(blue, 1000);   // final
  EXPECT_GT(orange, 300);  // odometry, where it drifted away
}

TEST(WriteSession, ALiveSessionWhoseGraphLagsBehindHasAllPoses) {
  auto session = block_session();
  const Pose shift({1, 0, 0, 0}, {5, 6, 0});
  session.view.graph.ended = false;
  session.view.graph.trajectory.clear();
  session.view.graph.map_from_submap.resize(1);
  session.view.graph.map_from_odom = shift;
  session.view.graph.closures.clear();
  const TemporaryFolder folder;
  WriteOptions options;
  options.map = options.report = false;
  write_session(session.view, folder.path(), {}, options);
  EXPECT_FALSE(fs::exists(folder / "map.ply"));
  const Trajectory poses = read_trajectory(folder / "poses_kitti.txt");
  const Trajectory odometry = read_trajectory(folder / "poses_odometry_kitti.txt");
  ASSERT_EQ(poses.size(), session.truth.size());
  for (std::size_t i = 40; i < poses.size(); ++i) {
    EXPECT_LT(
        (poses.poses[i].topRows<3>() - (shift * Pose::from_matrix(odometry.poses[i].topRows<3>())).matrix())
            .norm(),
        1e-6);
  }
}

TEST(WriteSession, AnEmptySessionIsWrittenToo) {
  SessionView view;
  view.read_submap = [](std::int64_t) -> Submap { throw std::logic_error("there is none"); };
  const TemporaryFolder folder;
  EXPECT_EQ(write_session(view, folder.path(), {}).size(), 12U);
  EXPECT_EQ(content(folder / "poses_kitti.txt"), "");
  EXPECT_FALSE(cv::imread(folder / "map_topdown.png").empty());
  EXPECT_THAT(content(folder / "report.html"), HasSubstr("The session holds no scan yet."));
}

TEST(WriteSession, AFolderThatCannotBeMadeOrWrittenIsNamed) {
  const TemporaryFolder folder;
  std::ofstream(folder / "file") << "x";
  try {
    write_session({}, folder / "file/out", {});
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("file/out"));
    EXPECT_THAT(e.what(), HasSubstr("--out"));
  }
  EXPECT_THROW(prepare_output_folder("/proc/hp2"), Error);
  prepare_output_folder(folder / "a/b");
  EXPECT_TRUE(fs::is_empty(folder / "a/b"));
}

TEST(WriteSession, ASubmapThatCannotBeReadLeavesTheOldFilesAsTheyWere) {
  auto session = block_session();
  const TemporaryFolder folder;
  write_session(session.view, folder.path(), {});
  const std::string before = content(folder / "map.ply");
  const auto read = session.view.read_submap;
  session.view.read_submap = [read](std::int64_t id) {
    if (id == 2) throw Error("the submap is damaged", "submap 2", "Run again.");
    return read(id);
  };
  EXPECT_THROW(write_session(session.view, folder.path(), {}), Error);
  EXPECT_TRUE(content(folder / "map.ply") == before);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 12);
}

TEST(VoxelSet, HoldsEachVoxelOnceOnBothSidesOfZero) {
  VoxelSet set(0.5);
  std::set<std::array<int, 3>> slow;
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(-6, 6);
  for (int i = 0; i < 20000; ++i) {
    const Eigen::Vector3d p(uniform(rng), uniform(rng) - 1000, uniform(rng));
    const Eigen::Vector3d cell = (p * 2).array().floor();
    EXPECT_EQ(set.insert(p), slow.insert({int(cell.x()), int(cell.y()), int(cell.z())}).second);
  }
  EXPECT_FALSE(set.insert({1e9, 0, 0}));
  EXPECT_TRUE(VoxelSet(0.0).insert({1, 2, 3}));
}

}  // namespace
}  // namespace hp2
