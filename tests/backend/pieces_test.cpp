// Tracking lost and found again: pieces of a session that only a closure holds together.
#include "backend/graph/pieces.hpp"

#include <cmath>

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "backend/backend.hpp"
#include "backend_fixtures.hpp"

namespace hp2 {
namespace {

using testing::random_submap;
using testing::street_scene;

Submap with_states(std::initializer_list<int> lost, int n_scans = 10) {
  Submap m = random_submap(0, {}, 100, n_scans);
  for (const int i : lost) m.scans[static_cast<std::size_t>(i)].state = TrackingState::kLost;
  return m;
}

TEST(Pieces, TheLargerSideOfALossHasTheKeypose) {
  const auto whole = anchored_scans(with_states({}).scans);
  EXPECT_EQ(whole.begin, 0U);
  EXPECT_EQ(whole.end, 10U);
  EXPECT_FALSE(whole.starts_piece || whole.ends_piece);
  const auto at_once = anchored_scans(with_states({0}).scans);
  EXPECT_EQ(at_once.begin, 0U);
  EXPECT_EQ(at_once.end, 10U);
  EXPECT_TRUE(at_once.starts_piece);
  const auto early = anchored_scans(with_states({1, 3}).scans);
  EXPECT_EQ(early.begin, 3U);
  EXPECT_TRUE(early.starts_piece && !early.ends_piece);
  const auto late = anchored_scans(with_states({7, 8}).scans);
  EXPECT_EQ(late.begin, 0U);
  EXPECT_EQ(late.end, 7U);
  EXPECT_TRUE(late.ends_piece && !late.starts_piece);
  const Submap kept = anchored_submap(with_states({7, 8}));
  EXPECT_EQ(kept.scans.size(), 7U);
  EXPECT_EQ(kept.points.size(), 70U);
  for (const auto i : kept.scan_indices) EXPECT_LT(i, 7);
  EXPECT_TRUE(anchored_scans({}).end == 0 && !anchored_scans({}).starts_piece);
}

double deviation(const GraphEdge& edge, int direction) {
  return std::sqrt(Matrix6d(edge.information.inverse())(direction, direction));
}

TEST(Pieces, AnEdgeAcrossALossKnowsNextToNothing) {
  const Submap a = random_submap(0, {}, 10);
  Submap b = random_submap(1, {}, 10);
  const GraphEdge good = odometry_edge(a, b, 0);
  for (int k = 0; k < 3; ++k) EXPECT_LT(deviation(good, k), 0.1);
  for (int k = 3; k < 6; ++k) EXPECT_LT(deviation(good, k), 0.02);
  b.scans[0].state = TrackingState::kLost;
  for (ScanPose& s : b.scans) s.utime += 5000000;
  const GraphEdge lost = odometry_edge(a, b, 0);
  for (int k = 0; k < 3; ++k) EXPECT_GT(deviation(lost, k), 20.0);  // 5 s at 2 m/s^2
  for (int k = 3; k < 6; ++k) EXPECT_GT(deviation(lost, k), 1.5);
  // The edge after it does not pay for the loss.
  const GraphEdge after = odometry_edge(b, random_submap(2, {}, 10), a.scans.back().utime);
  for (int k = 0; k < 3; ++k) EXPECT_LT(deviation(after, k), 0.1);
}

TEST(Pieces, AreMovedAsAWholeToWhereAClosureHasThem) {
  std::vector<Pose> truth, nodes;
  const Pose off = se3_exp((Vector6d() << 40, -30, 2, 0.1, 0.2, 2.5).finished());
  const std::vector<int> piece{0, 0, 0, 1, 1, 2};
  Pose p;
  for (std::size_t i = 0; i < piece.size(); ++i) {
    truth.push_back(p);
    nodes.push_back(piece[i] == 0 ? p : piece[i] == 1 ? off * p : off * off * p);
    p = p * se3_exp((Vector6d() << 10, 1, 0, 0, 0.02, 0.4).finished());
  }
  const auto measured = [&](std::size_t a, std::size_t b) {
    return GraphEdge{a, b, truth[a].inverse() * truth[b], Matrix6d::Identity()};
  };
  place_pieces(nodes, piece,
               {measured(3, 5), measured(1, 4)});  // the last piece is placed by way of the middle
  for (std::size_t i = 0; i < nodes.size(); ++i)
    EXPECT_LT(se3_log(truth[i].inverse() * nodes[i]).norm(), 1e-9);
}

// Scans along x through the crossing of street_scene at sensor height; the submap's frame is given by where
// the first scan is in it.
Submap through_the_street(std::int64_t id, unsigned seed, const Pose& scene_from_start,
                          const Pose& submap_from_start, std::int64_t first_sequence, std::int64_t utime) {
  Submap m;
  m.id = id;
  const Pose submap_from_scene = submap_from_start * scene_from_start.inverse();
  m.points = street_scene(seed, 0.02, submap_from_scene);
  m.normals.assign(m.points.size(), Eigen::Vector3f::Zero());
  m.scan_indices.assign(m.points.size(), 0);
  for (int i = 0; i <= 20; ++i) {
    ScanPose s;
    s.sequence = first_sequence + i;
    s.utime = utime + 100000 * i;
    s.submap_from_sensor = submap_from_start * Pose({1, 0, 0, 0}, {1.0 * i, 0, 0});
    s.covariance = 1e-6 * Matrix6d::Identity();
    m.scans.push_back(s);
  }
  m.travelled_m = 20.0;
  return m;
}

TEST(Backend, TheMapBeginsAtTheFirstScanWhereverOdometryBegan) {
  testing::TemporaryFolder folder;
  SessionStore store(folder.path());
  Backend backend({}, store);
  const Pose start(so3_exp({0.01, 0, 0.5}), {-30, 4, 1});
  Submap first = random_submap(0, start),
         second = random_submap(1, start * first.scans.back().submap_from_sensor);
  backend.add_submap(first, {}, false);
  backend.add_submap(second, {}, true);
  const GraphState& graph = backend.graph();
  EXPECT_LT(se3_log(graph.map_from_submap[0]).norm(), 1e-9);
  EXPECT_LT(se3_log(graph.map_from_odom * start).norm(), 1e-9);
  for (const TrajectoryPose& p : graph.trajectory) {
    EXPECT_LT(se3_log((start * p.map_from_sensor).inverse() * p.odom_from_sensor).norm(), 1e-6) << p.sequence;
  }
}

TEST(Pieces, AreJoinedWhenThePlaceIsSeenAgain) {
  testing::TemporaryFolder folder;
  SessionStore store(folder.path());
  Backend backend({}, store);
  const Pose scene_from_first({1, 0, 0, 0}, {-10, 0, 1.8});
  Submap here = through_the_street(0, 1, scene_from_first, Pose(), 0, 1000000);
  backend.add_submap(here, {}, false);
  Pose odom = here.scans.back().submap_from_sensor;
  std::int64_t utime = here.scans.back().utime;
  // A way with nothing to see leads off.
  Submap away = random_submap(1, odom, 0, 30);
  for (std::size_t i = 0; i < away.scans.size(); ++i) {
    away.scans[i].sequence = 21 + static_cast<std::int64_t>(i);
    away.scans[i].utime = utime += 100000;
  }
  backend.add_submap(away, {}, false);
  odom = odom * away.scans.back().submap_from_sensor;
  // 5 s are missing; the front-end's prediction is anything. In truth the sensor is back at the crossing,
  // looking the other way.
  const Pose scene_from_again(so3_exp({0.01, -0.02, 2.9}), {11, 1, 1.9});
  const Pose guess = se3_exp((Vector6d() << 25, 3, 1, 0.02, 0, 0.6).finished());
  Submap again = through_the_street(2, 2, scene_from_again, guess, 51, utime + 5000000);
  again.odom_from_submap = odom;
  again.scans.front().state = TrackingState::kLost;
  const BackendUpdate update = backend.add_submap(again, {}, true);
  EXPECT_TRUE(update.graph_changed);
  const auto expect_joined = [&](const GraphState& graph) {
    ASSERT_EQ(graph.trajectory.size(), 21U + 30U + 21U);
    for (std::size_t i = 0; i < graph.trajectory.size(); ++i) {
      const TrajectoryPose& p = graph.trajectory[i];
      if (p.submap < 2) {
        // What was known stays: the first piece is not bent towards the second.
        EXPECT_LT(se3_log(p.odom_from_sensor.inverse() * p.map_from_sensor).norm(), 0.02) << i;
        continue;
      }
      const Pose truth = scene_from_first.inverse() * scene_from_again *
                         Pose({1, 0, 0, 0}, {1.0 * static_cast<double>(i - 51), 0, 0});
      EXPECT_LT((truth.translation - p.map_from_sensor.translation).norm(), 0.15) << i;
      EXPECT_LT(rotation_angle(truth.rotation.conjugate() * p.map_from_sensor.rotation), 0.01) << i;
      EXPECT_GT((truth.translation - p.odom_from_sensor.translation).norm(), 10.0);
    }
  };
  expect_joined(backend.graph());
  // What is read back from the disk, and what a back-end started again makes of it, is the same.
  expect_joined(store.read_graph());
  BackendConfig unsmoothed;  // the way with nothing to see is none that a sensor with inertia would take
  unsmoothed.smooth_scans = false;
  Backend restarted(unsmoothed, store);
  restarted.finish();
  expect_joined(restarted.graph());
}

}  // namespace
}  // namespace hp2
