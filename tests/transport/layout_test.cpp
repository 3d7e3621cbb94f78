#include "common/transport/layout.hpp"

#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>

#include "common/transport/convert.hpp"

namespace hp2 {
namespace {

using Rng = std::mt19937;

std::string random_text(Rng& rng) { return std::string(rng() % 20, 'a'); }

// Messages of every type with arrays of random sizes.
void fill(Rng& rng, chunk_t& m) { m.data.resize(static_cast<std::size_t>(m.size = rng() % 50)); }
void fill(Rng& rng, closure_t& m) { m.reason = random_text(rng); }
void fill(Rng& rng, control_t& m) { m.target = random_text(rng); }
void fill(Rng&, correction_t&) {}
void fill(Rng& rng, fetch_t& m) {
  m.topic = random_text(rng);
  m.indices.resize(static_cast<std::size_t>(m.n = rng() % 9));
}
void fill(Rng& rng, graph_t& m) {
  m.map_from_submap.resize(static_cast<std::size_t>(m.n_nodes = rng() % 9));
  m.odometry.resize(static_cast<std::size_t>(m.n_odometry = rng() % 9));
  m.closures.resize(static_cast<std::size_t>(m.n_closures = rng() % 9));
  for (auto& c : m.closures) fill(rng, c);
}
void fill(Rng&, odometry_t&) {}
void fill(Rng& rng, offer_t& m) { m.topic = random_text(rng); }
void fill(Rng& rng, resume_t& m) { m.state.resize(static_cast<std::size_t>(m.state_size = rng() % 90)); }
void fill(Rng& rng, scan_t& m) {
  m.sensor = random_text(rng);
  m.n = rng() % 30;
  m.n_intensity = rng() % 2 == 0 ? m.n : 0;
  m.n_time = rng() % 2 == 0 ? m.n : 0;
  for (auto* v : {&m.x, &m.y, &m.z}) v->resize(static_cast<std::size_t>(m.n));
  m.intensity.resize(static_cast<std::size_t>(m.n_intensity));
  m.time.resize(static_cast<std::size_t>(m.n_time));
}
void fill(Rng& rng, status_t& m) {
  m.process = random_text(rng);
  m.version = random_text(rng);
  m.host = random_text(rng);
  m.text = random_text(rng);
  m.counters.resize(static_cast<std::size_t>(m.n_counters = rng() % 9));
  for (auto& c : m.counters) c.name = random_text(rng);
}
void fill(Rng& rng, submap_t& m) {
  const auto n = static_cast<std::size_t>(m.n = rng() % 30);
  for (auto* v : {&m.x, &m.y, &m.z}) v->resize(n);
  for (auto* v : {&m.nx, &m.ny, &m.nz}) v->resize(n);
  m.scan_index.resize(n);
  m.scans.resize(static_cast<std::size_t>(m.n_scans = rng() % 9));
  m.state.resize(static_cast<std::size_t>(m.state_size = rng() % 90));
}
void fill(Rng& rng, trajectory_t& m) {
  const auto n = static_cast<std::size_t>(m.n = rng() % 9);
  m.sequence.resize(n);
  m.utime.resize(n);
  m.submap.resize(n);
  m.odom_from_sensor.resize(n);
  m.map_from_sensor.resize(n);
}

template <class T>
class Layout : public ::testing::Test {};
using Types = ::testing::Types<chunk_t, closure_t, control_t, correction_t, fetch_t, graph_t, odometry_t,
                               offer_t, resume_t, scan_t, status_t, submap_t, trajectory_t>;
TYPED_TEST_SUITE(Layout, Types);

TYPED_TEST(Layout, AcceptsWhatTheTypeEncodesAndNothingShorterOrLonger) {
  Rng rng(5);
  for (int round = 0; round < 20; ++round) {
    TypeParam message{}, decoded;
    fill(rng, message);
    auto bytes = encode_message(message);
    ASSERT_TRUE(safe_decode(bytes.data(), bytes.size(), decoded));
    EXPECT_EQ(encode_message(decoded), bytes);
    for (std::size_t n = 0; n < bytes.size(); ++n) {
      const std::vector<std::uint8_t> cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
      ASSERT_FALSE(safe_decode(cut.data(), cut.size(), decoded)) << "cut to " << n << " of " << bytes.size();
    }
    bytes.push_back(0);
    EXPECT_FALSE(safe_decode(bytes.data(), bytes.size(), decoded));
  }
}

TYPED_TEST(Layout, SurvivesAbsurdCountsEverywhere) {
  Rng rng(6);
  TypeParam message{}, decoded;
  fill(rng, message);
  const auto bytes = encode_message(message);
  for (std::size_t at = 8; at + 4 <= bytes.size(); ++at) {
    for (const std::uint32_t count : {0x7FFFFFFFU, 0x80000000U, 0xFFFFFFFFU, 0x10000000U}) {
      auto spoiled = bytes;
      for (std::size_t k = 0; k < 4; ++k) spoiled[at + k] = static_cast<std::uint8_t>(count >> (24 - 8 * k));
      safe_decode(spoiled.data(), spoiled.size(),
                  decoded);  // whether it is one or not: no crash, no huge allocation
    }
  }
  auto wrong = bytes;
  wrong[3] ^= 1U;
  EXPECT_FALSE(safe_decode(wrong.data(), wrong.size(), decoded)) << "wrong fingerprint";
}

// 300,000 altered messages of all types through every check that the processes apply.
TEST(Convert, SurvivesRubbish) {
  Rng rng(7);
  std::vector<ByteVector> seeds;
  const auto add = [&](auto message) {
    fill(rng, message);
    seeds.push_back(encode_message(message));
  };
  for (int i = 0; i < 5; ++i) {
    add(graph_t{});
    add(resume_t{});
    add(scan_t{});
    add(submap_t{});
    add(trajectory_t{});
    add(status_t{});
    add(chunk_t{});
  }
  for (int i = 0; i < 300'000; ++i) {
    auto bytes = seeds[rng() % seeds.size()];
    for (unsigned k = rng() % 6; k > 0; --k)
      bytes[8 + rng() % (bytes.size() - 8)] = static_cast<std::uint8_t>(rng());
    if (rng() % 4 == 0) bytes.resize(rng() % (bytes.size() + 1));
    const auto* data = bytes.data();
    const std::size_t size = bytes.size();
    decode_scan(data, size);
    const auto piece = view_chunk(data, size);
    if (piece) {
      ASSERT_EQ(piece->data + piece->size, data + size);
    }
    decode_submap(data, size, 0);
    decode_graph(data, size, 0);
    decode_trajectory(data, size, 0);
    status_t status;
    safe_decode(data, size, status);
  }
}

TEST(Convert, SubmapsAndPosesComeBackBitForBit) {
  Rng rng(8);
  std::normal_distribution<double> normal;
  const auto random_pose = [&] {
    return Pose(Eigen::Quaterniond(normal(rng), normal(rng), normal(rng), normal(rng)),
                {100 * normal(rng), normal(rng), normal(rng)});
  };
  SubmapPackage package;
  package.submap.id = 3;
  package.submap.odom_from_submap = random_pose();
  package.submap.points = {{1, 2, 3}, {4, 5, 6}};
  package.submap.normals = {{0, 0, 1}, {0, 0, 0}};
  package.submap.scan_indices = {0, 1};
  for (int i = 0; i < 2; ++i) {
    ScanPose scan;
    scan.sequence = 10 + i;
    scan.submap_from_sensor = random_pose();
    scan.covariance = Matrix6d::Random();
    scan.state = TrackingState::kDegenerate;
    package.submap.scans.push_back(scan);
  }
  package.frontend_state = {1, 2, 3};
  package.last = true;
  const auto bytes = encode_submap(package, 9);
  EXPECT_FALSE(decode_submap(bytes.data(), bytes.size(), 8)) << "another session's";
  const auto back = decode_submap(bytes.data(), bytes.size(), 9);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->submap.id, 3);
  EXPECT_TRUE(back->last);
  EXPECT_EQ(back->frontend_state, package.frontend_state);
  EXPECT_EQ(back->submap.points, package.submap.points);
  EXPECT_EQ(back->submap.normals, package.submap.normals);
  ASSERT_EQ(back->submap.scans.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto &a = back->submap.scans[i], &b = package.submap.scans[i];
    EXPECT_EQ(a.submap_from_sensor.rotation.coeffs(), b.submap_from_sensor.rotation.coeffs());
    EXPECT_EQ(a.submap_from_sensor.translation, b.submap_from_sensor.translation);
    EXPECT_EQ(a.covariance, b.covariance);
    EXPECT_EQ(a.state, b.state);
  }
}

TEST(Convert, PosesThatAreNoneAreRefused) {
  pose_t m = to_message(Pose());
  EXPECT_TRUE(to_pose(m));
  m.rotation[0] = 0.9;
  EXPECT_FALSE(to_pose(m)) << "not of unit length";
  m = to_message(Pose());
  m.translation[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(to_pose(m));
  m = to_message(Pose());
  m.translation[1] = 1e9;
  EXPECT_FALSE(to_pose(m)) << "farther than any drive goes";
}

}  // namespace
}  // namespace hp2
