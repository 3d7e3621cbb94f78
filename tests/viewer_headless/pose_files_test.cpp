#include "viewer_headless/pose_files.hpp"

#include <sstream>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backend/graph/pieces.hpp"
#include "backend/graph/pose_graph.hpp"
#include "tests/viewer_headless/made_up_session.hpp"
#include "viewer_headless/ground_truth.hpp"
#include "viewer_headless/summary.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;

testing::MadeUpSession session() {
  testing::MadeUpOptions options;
  options.scans_a_submap = 40;
  return testing::make_session(
      testing::block_drive(80, 1.6), [](std::size_t) { return std::vector<Eigen::Vector3f>(); }, options,
      se3_exp((Vector6d() << 100, -50, 3, 0.1, 0.2, 2.0).finished()));
}

struct G2oEdge {
  int from, to;
  Pose pose;
  Matrix6d information;
};

void read_g2o(const std::string& text, std::vector<Pose>& vertices, std::vector<G2oEdge>& edges, int& fixed) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream in(line);
    std::string tag;
    in >> tag;
    double v[7];
    const auto pose = [&] {
      for (double& x : v) in >> x;
      return Pose(Eigen::Quaterniond(v[6], v[3], v[4], v[5]), {v[0], v[1], v[2]});
    };
    if (tag == "FIX") {
      in >> fixed;
    } else if (tag == "VERTEX_SE3:QUAT") {
      std::size_t id = 0;
      in >> id;
      ASSERT_EQ(id, vertices.size());
      vertices.push_back(pose());
    } else {
      ASSERT_EQ(tag, "EDGE_SE3:QUAT");
      G2oEdge e;
      in >> e.from >> e.to;
      e.pose = pose();
      for (int r = 0; r < 6; ++r) {
        for (int c = r; c < 6; ++c) {
          in >> e.information(r, c);
          e.information(c, r) = e.information(r, c);
        }
      }
      ASSERT_FALSE(in.fail());
      edges.push_back(e);
    }
  }
}

// g2o's error of an edge: translation and vector part of the quaternion of measurement^-1 from^-1 to.
Vector6d g2o_error(const Pose& measurement, const Pose& from_from_to) {
  const Pose d = measurement.inverse() * from_from_to;
  Vector6d e;
  e << d.translation, d.rotation.vec() * (d.rotation.w() < 0 ? -1 : 1);
  return e;
}

TEST(G2o, ReadsBackAsTheGraph) {
  const auto s = session();
  const SessionDigest digest = digest_session(s.view, {});
  std::vector<Pose> vertices;
  std::vector<G2oEdge> edges;
  int fixed = -1;
  read_g2o(graph_g2o(digest, s.view.graph.closures), vertices, edges, fixed);
  EXPECT_EQ(fixed, 0);
  ASSERT_EQ(vertices.size(), s.view.graph.map_from_submap.size());
  std::size_t closures = 0;
  for (const auto& e : edges) {
    const Pose truth = vertices[e.from].inverse() * vertices[e.to];
    if (e.to == e.from + 1) {
      // Odometry: drifts by 0.4 % and 2e-4 rad/m.
      EXPECT_LT((e.pose.translation - truth.translation).norm(), 1.0);
      EXPECT_GT((e.pose.translation - truth.translation).norm(), 0.05);
    } else {
      ++closures;
      EXPECT_LT(se3_log(truth.inverse() * e.pose).norm(), 1e-7);
    }
    EXPECT_GT(e.information.determinant(), 0);
  }
  const auto accepted = std::count_if(s.view.graph.closures.begin(), s.view.graph.closures.end(),
                                      [](const auto& c) { return c.accepted; });
  EXPECT_GT(accepted, 0);
  EXPECT_EQ(closures, static_cast<std::size_t>(accepted));
  EXPECT_EQ(edges.size(), closures + vertices.size() - 1);
}

TEST(G2o, InformationIsThatOfG2osOwnParameters) {
  // What the pose graph charges for a pose that is off by d: e^T I e of edge_error(), right increments. g2o's
  // error of the same pose with the written information must cost the same, whatever the frames and axes.
  auto s = session();
  SessionDigest digest;
  digest.map_from_submap = {Pose(), Pose()};
  ClosureRecord c;
  c.from_submap = 0;
  c.to_submap = 1;
  c.accepted = true;
  c.from_from_to = se3_exp((Vector6d() << 4, -3, 1, 0.3, -0.5, 1.2).finished());
  Matrix6d a = Matrix6d::Random();
  c.information = a * a.transpose() + Matrix6d::Identity();
  std::vector<Pose> vertices;
  std::vector<G2oEdge> edges;
  int fixed = -1;
  read_g2o(graph_g2o(digest, {c}), vertices, edges, fixed);
  ASSERT_EQ(edges.size(), 1U);
  const Vector6d d = 1e-4 * (Vector6d() << 1, -2, 3, 2, 1, -1).finished();
  const Pose from = se3_exp((Vector6d() << -7, 2, 1, 0.4, 0.1, 2.2).finished());
  const Pose to = from * c.from_from_to * se3_exp(d);
  const Vector6d e = g2o_error(edges[0].pose, from.inverse() * to);
  const Vector6d ours = edge_error(from, to, c.from_from_to, nullptr, nullptr);
  const double expected = ours.dot(c.information * ours);
  EXPECT_NEAR(e.dot(edges[0].information * e), expected, 2e-3 * expected);
}

TEST(Digest, OdometryIsWhatTheBackEndWeighsItAs) {
  SessionView view;
  view.submap_count = 2;
  const Pose t1 = se3_exp((Vector6d() << 1, 0, 0, 0, 0, 0.2).finished()),
             t2 = se3_exp((Vector6d() << 2, 1, 0, 0, 0.1, 0.3).finished());
  Matrix6d s1 = Matrix6d::Identity() * 1e-4, s2 = Matrix6d::Identity() * 3e-4;
  s1(0, 0) = 5e-4;
  view.read_submap = [&](std::int64_t id) {
    Submap submap;
    submap.id = id;
    submap.odom_from_submap = Pose({1, 0, 0, 0}, {-18, 0, 0}) * (id == 0 ? Pose() : t1 * t2);
    ScanPose a, b;
    a.sequence = 2 * id;
    b.sequence = 2 * id + 1;
    a.submap_from_sensor = t1;
    b.submap_from_sensor = t1 * t2;
    a.covariance = s1;
    b.covariance = s2;
    submap.scans = {a, b};
    return submap;
  };
  const GraphEdge expected = odometry_edge(view.read_submap(0), view.read_submap(1), 0);
  view.graph.odometry = {expected};
  const SessionDigest digest = digest_session(view, {});
  // The odometry's way begins where the map does, not where odometry says that it began.
  ASSERT_EQ(digest.scans.size(), 4U);
  EXPECT_LT(se3_log(digest.scans[1].odom_from_sensor.inverse() * (t1 * t2)).norm(), 1e-12);
  ASSERT_EQ(digest.odometry.size(), 1U);
  EXPECT_EQ(digest.odometry[0].information, expected.information);
  EXPECT_EQ(digest.odometry[0].to, 1U);
  // Never surer than the chain of what the registrations say: Exp(d1) T2 Exp(d2) has the covariance
  // Ad(T2^-1) S1 Ad(T2^-1)^T + S2 on the right.
  const Matrix6d ad = adjoint(t2.inverse());
  const Matrix6d chain = ad * s1 * ad.transpose() + s2;
  const Matrix6d more = digest.odometry[0].information.inverse() - chain;
  EXPECT_GE(Eigen::SelfAdjointEigenSolver<Matrix6d>(more).eigenvalues().minCoeff(), -1e-9);
  EXPECT_LT(se3_log(digest.odometry[0].from_from_to.inverse() * (t1 * t2)).norm(), 1e-12);
}

TEST(Closures, CsvHasEveryVerdictAndQuotesReasons) {
  ClosureRecord yes, no;
  yes.from_submap = 1;
  yes.to_submap = 7;
  yes.inliers = 9;
  yes.overlap = 0.5;
  yes.residual_m = 0.125;
  yes.accepted = true;
  yes.from_from_to = Pose({0, 0, 0, 1}, {1.5, 2, 3});
  no.from_submap = 2;
  no.to_submap = 8;
  no.reason = "inliers 3, needs 5";
  EXPECT_EQ(closures_csv({yes, no}),
            "from_submap,to_submap,inliers,overlap,residual_m,accepted,reason,tx,ty,tz,qx,qy,qz,qw\n"
            "1,7,9,0.5,0.125,true,,1.5,2,3,0,0,1,0\n"
            "2,8,0,,,false,\"inliers 3, needs 5\",0,0,0,0,0,0,1\n");
}

TEST(GroundTruth, OfAnotherFrameAlignsAndScoresTheOdometryAlone) {
  auto s = session();
  const SessionDigest digest = digest_session(s.view, {});
  s.view.ground_truth[3].translation.x() = std::nan("");
  const auto truth = compare_with_ground_truth(digest, s.view.ground_truth);
  ASSERT_TRUE(truth.has_value());
  EXPECT_EQ(truth->scans.size(), digest.scans.size() - 1);
  EXPECT_LT(truth->corrected.ate.max, 1e-9);
  EXPECT_GT(truth->odometry.ate.rmse, 0.3);
  EXPECT_LT(
      (truth->map_from_truth * transformed(Eigen::Matrix4d::Identity(), truth->corrected.reference).poses[0] -
       [&] {
         Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
         m.topRows<3>() = s.truth[0].matrix();
         return m;
       }())
          .norm(),
      1e-8);
  EXPECT_FALSE(compare_with_ground_truth(digest, {}).has_value());
}

TEST(Summary, HasTheFixedMembersAndTheRightCounts) {
  auto s = session();
  s.view.scans_in = static_cast<std::int64_t>(s.truth.size()) + 7;
  s.view.viewer_peak_memory_mb = 45.6;
  const SessionDigest digest = digest_session(s.view, {});
  const auto json = make_summary(s.view, digest, compare_with_ground_truth(digest, s.view.ground_truth), 123);
  EXPECT_EQ(json["scans_in"], s.view.scans_in);
  EXPECT_EQ(json["poses_out"], s.truth.size());
  EXPECT_EQ(json["scans_lost"], 7);
  EXPECT_NEAR(json["scans_per_s"].get<double>(), 80.0, 1e-9);
  EXPECT_NEAR(json["path_m"].get<double>(), static_cast<double>(s.truth.size() - 1), 1e-6);
  for (const char* stage : {"preprocess", "neighbour_search", "planarity", "solve", "map_update", "total"}) {
    const auto& ms = json["milliseconds"][stage];
    for (const char* key : {"mean", "median", "p99"}) EXPECT_TRUE(ms[key].is_number()) << stage << key;
    EXPECT_LE(ms["median"].get<double>(), ms["p99"].get<double>());
    EXPECT_LE(ms["p99"].get<double>(), ms["max"].get<double>());
  }
  EXPECT_EQ(json["peak_memory_mb"]["hp2_frontend"], 123.4);
  EXPECT_EQ(json["peak_memory_mb"]["hp2_viewer_headless"], 45.6);
  EXPECT_EQ(json["versions"]["hp2_player"], "0.1.0");
  EXPECT_EQ(json["counters"]["hp2_backend"]["chunks_resent"], 3);
  EXPECT_THAT(json["configuration"]["configuration"].get<std::string>(), HasSubstr("mode: hybrid"));
  EXPECT_LT(json["accuracy"]["final"]["ate"]["rmse"].get<double>(), 1e-9);
  // Bytes that are no UTF-8 and numbers that are none must not break the file.
  s.view.meta["data"] = "caf\xe9";
  s.view.processes["hp2_player"]["peak_memory_mb"] = std::nan("");
  EXPECT_TRUE(nlohmann::json::accept(dump(make_summary(s.view, digest, std::nullopt, -1))));
}

}  // namespace
}  // namespace hp2
