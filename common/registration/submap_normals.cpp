#include "common/registration/submap_normals.hpp"

#include "common/registration/local_map.hpp"

namespace hp2 {

void estimate_normals(Submap& submap) {
  constexpr double kVoxel = 1.0;
  constexpr float kPlanar = 0.1F;  // planarity score below which a normal is worth giving
  LocalMap map(kVoxel, 8, 0.0);
  map.insert(submap.points, Pose());
  submap.normals.assign(submap.points.size(), Eigen::Vector3f::Zero());
  LocalMap::Cursor cursor;  // one point is near the one before
  for (std::size_t i = 0; i < submap.points.size(); ++i) {
    const NearestPoint at = map.nearest(map.locate(submap.points[i].cast<double>()), cursor);
    if (at.voxel < 0) continue;
    if (map.planarity_stale(at.voxel)) map.update_planarity(at.voxel);
    const Planarity& shape = map.planarity(at.voxel);
    if (shape.n >= 5.0F && shape.score < kPlanar) submap.normals[i] = shape.normal;
  }
}

}  // namespace hp2
