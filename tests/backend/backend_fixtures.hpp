// Submaps and folders for the back-end's tests.
#pragma once
#include <cmath>
#include <random>
#include <string>

#include "common/submap.hpp"
#include "tests/temporary_folder.hpp"

namespace hp2::testing {

using test::TemporaryFolder;

/// A submap of random points, `n_scans` scans in a gentle turn, its keypose where `odom_from_submap` says.
inline Submap random_submap(std::int64_t id, const Pose& odom_from_submap, int n_points = 1000,
                            int n_scans = 10) {
  std::mt19937 rng(static_cast<unsigned>(id + 1));
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<float> uniform(-50.0F, 50.0F);
  Submap m;
  m.id = id;
  m.odom_from_submap = odom_from_submap;
  for (int i = 0; i < n_points; ++i) {
    m.points.emplace_back(uniform(rng), uniform(rng), 0.1F * uniform(rng));
    const Eigen::Vector3d n(normal(rng), normal(rng), normal(rng));
    m.normals.push_back((i % 7 == 0 ? Eigen::Vector3d(0, 0, 0) : n.normalized()).cast<float>());
    m.scan_indices.push_back(i % n_scans);
  }
  Pose pose;
  for (int i = 0; i < n_scans; ++i) {
    Vector6d step;
    step << 1.0 + 0.1 * normal(rng), 0.01 * normal(rng), 0.01 * normal(rng), 0.001 * normal(rng),
        0.001 * normal(rng), 0.03;
    pose = pose * se3_exp(step);
    ScanPose s;
    s.sequence = id * n_scans + i;
    s.utime = 100000 * (s.sequence + 1);
    s.submap_from_sensor = pose;
    s.covariance = 1e-6 * Matrix6d::Identity();
    s.covariance(0, 1) = s.covariance(1, 0) = 2e-7;
    s.state = i == 3 ? TrackingState::kDegenerate : TrackingState::kTracking;
    s.diagnostics = {0.7F, 0.3F, 0.05F, 12, {1, 2, 3, 4, 5, 6}};
    m.scans.push_back(s);
    m.travelled_m += step.head<3>().norm();
  }
  return m;
}

/// `n` submaps, each beginning where the one before ended.
inline std::vector<Submap> random_chain(int n, int n_points = 1000) {
  std::vector<Submap> chain;
  Pose keypose;
  for (int k = 0; k < n; ++k) {
    chain.push_back(random_submap(k, keypose, n_points));
    keypose = keypose * chain.back().scans.back().submap_from_sensor;
  }
  return chain;
}

/// A crossing of two streets with houses, parked cars, walls and trees, sampled about every 0.4 m with noise;
/// what stands there is always the same, where the samples fall depends on `seed`. Scene frame: z up, ground
/// at z = 0.
inline std::vector<Eigen::Vector3f> street_scene(unsigned seed, double noise_m, const Pose& out_from_scene) {
  std::mt19937 world(99), rng(seed);
  std::normal_distribution<double> noise(0.0, noise_m);
  std::uniform_real_distribution<double> jitter(-0.2, 0.2), unit(0.0, 1.0);
  std::vector<Eigen::Vector3f> points;
  const auto put = [&](double x, double y, double z) {
    const Eigen::Vector3d p(x + noise(rng), y + noise(rng), z + noise(rng));
    points.push_back((out_from_scene * p).cast<float>());
  };
  const auto wall = [&](double x0, double y0, double x1, double y1, double height) {
    const double length = std::hypot(x1 - x0, y1 - y0);
    for (double s = 0.0; s < length; s += 0.4) {
      for (double z = 0.0; z < height; z += 0.4) {
        const double f = (s + jitter(rng)) / length;
        put(x0 + f * (x1 - x0), y0 + f * (y1 - y0), z + jitter(rng));
      }
    }
  };
  for (double x = -45.0; x < 45.0; x += 0.6) {
    for (double y = -45.0; y < 45.0; y += 0.6) {
      if (std::abs(y) < 8.0 || std::abs(x - 10.0) < 7.0) put(x + jitter(rng), y + jitter(rng), 0.0);
    }
  }
  for (const double side : {-1.0, 1.0}) {
    for (double x = -45.0; x < 45.0;) {
      const double width = 5.0 + 10.0 * unit(world), set_back = 8.0 + 4.0 * unit(world),
                   height = 3.0 + 7.0 * unit(world);
      const double depth = 4.0 + 6.0 * unit(world);
      if (std::abs(x + 0.5 * width - 10.0) > 7.0 + 0.5 * width) {
        wall(x, side * set_back, x + width, side * set_back, height);
        wall(x, side * set_back, x, side * (set_back + depth), height);
      }
      x += width + 3.0 * unit(world);
    }
    for (int i = 0; i < 8; ++i) {
      const double x = -40.0 + 80.0 * unit(world), y = side * (5.0 + unit(world));
      wall(x, y, x + 4.0, y, 1.5);
      wall(x, y, x, y + 1.7 * side, 1.5);
      const double tx = -40.0 + 80.0 * unit(world), ty = side * 7.0;
      wall(tx, ty, tx + 0.5, ty, 6.0);
    }
  }
  return points;
}

}  // namespace hp2::testing
