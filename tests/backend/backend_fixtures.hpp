// Submaps and folders for the back-end's tests.
#pragma once
#include <cmath>
#include <filesystem>
#include <random>
#include <string>
#include <unistd.h>

#include "common/submap.hpp"

namespace hp2::testing {

/// A folder of its own, removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "hp2_backend_XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~TemporaryFolder() {
    std::error_code ec;
    std::filesystem::permissions(path_, std::filesystem::perms::owner_all, ec);
    std::filesystem::remove_all(path_, ec);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  std::string path() const { return path_; }
  std::string file() const { return path_ + "/session.sqlite"; }

 private:
  std::string path_;
};

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

}  // namespace hp2::testing
