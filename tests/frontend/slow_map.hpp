// What LocalMap promises, done the obvious way.
#pragma once
#include <array>
#include <cmath>
#include <iterator>
#include <map>
#include <vector>

#include "common/registration/local_map.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2::test {

using Eigen::Vector3d;
using Key = std::array<int, 3>;

/// Keeps every point in a std::map of voxels.
struct SlowMap {
  double size;
  std::size_t capacity;
  double spacing;
  std::map<Key, std::vector<Vector3d>> voxels;

  Key key(const Vector3d& p) const {
    return {static_cast<int>(std::floor(p.x() / size)), static_cast<int>(std::floor(p.y() / size)),
            static_cast<int>(std::floor(p.z() / size))};
  }
  void insert(const Cloud& cloud, const Pose& pose) {
    for (const auto& q : cloud) {
      const Vector3d p = pose * q.cast<double>();
      auto& points = voxels[key(p)];
      bool room = points.size() < capacity;
      for (const auto& o : points) room = room && (o - p).norm() >= spacing;
      if (room) points.push_back(p);
    }
  }
  void remove_far(const Vector3d& centre, double radius) {
    for (auto it = voxels.begin(); it != voxels.end();) {
      Vector3d middle;
      for (int a = 0; a < 3; ++a) {
        const double block = std::floor(it->first[static_cast<std::size_t>(a)] / 4.0);
        middle[a] = (block + 0.5) * 4.0 * size;
      }
      it = (middle - centre).norm() > radius ? voxels.erase(it) : std::next(it);
    }
  }
  std::vector<Vector3d> around(const Key& k) const {
    std::vector<Vector3d> out;
    for (int x = -1; x <= 1; ++x) {
      for (int y = -1; y <= 1; ++y) {
        for (int z = -1; z <= 1; ++z) {
          const auto it = voxels.find({k[0] + x, k[1] + y, k[2] + z});
          if (it != voxels.end()) out.insert(out.end(), it->second.begin(), it->second.end());
        }
      }
    }
    return out;
  }
  std::vector<Vector3d> all() const {
    std::vector<Vector3d> out;
    for (const auto& v : voxels) out.insert(out.end(), v.second.begin(), v.second.end());
    return out;
  }
};

/// A map and its slow twin through the same history.
struct Twins {
  LocalMap map;
  SlowMap slow;
  Twins(double size, int capacity, double spacing)
      : map(size, capacity, spacing), slow{size, static_cast<std::size_t>(capacity), spacing, {}} {}
  void insert(const Cloud& cloud, const Pose& pose) {
    map.insert(cloud, pose);
    slow.insert(cloud, pose);
  }
  void remove_far(const Vector3d& centre, double radius) {
    map.remove_far(centre, radius);
    slow.remove_far(centre, radius);
  }
};

}  // namespace hp2::test
