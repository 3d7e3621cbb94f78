#include "backend/closures/submap_bend.hpp"

#include <algorithm>
#include <cstddef>

namespace hp2 {
namespace {

constexpr std::size_t kSource = 2000;  // points of a half
constexpr float kSharp = 0.2F;         // [m]: distance of the same surface
constexpr double kInView = 0.1;  // share of a half's points: with fewer counterparts the half is out of view
constexpr double kBetter = 1.1;  // a half's own pose must agree this many times as well as the whole's

// Share of the points that the other submap has there too.
double agreement(const VoxelCloud& from, const std::vector<Eigen::Vector3f>& points, const Pose& pose) {
  const Eigen::Matrix3f r = pose.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = pose.translation.cast<float>();
  std::size_t n = 0;
  for (const auto& p : points) {
    const Eigen::Vector3f q = r * p + t;
    n += q.cwiseAbs().maxCoeff() < 1e5F && from.any_near(q, kSharp);
  }
  return static_cast<double>(n) / static_cast<double>(std::max<std::size_t>(1, points.size()));
}

}  // namespace

SubmapBend submap_bend(const CheckedSubmap& from, const CheckedSubmap& to, const Pose& from_from_to,
                       const Pose& to_from_middle) {
  Pose pose[2];
  double seen = 0.0;
  const std::size_t half = to.points.size() / 2,
                    stride = std::max<std::size_t>(1, (half + kSource - 1) / kSource);
  for (std::size_t k = 0; k < 2; ++k) {
    std::vector<Eigen::Vector3f> points;
    for (std::size_t i = k * half; i < (k == 0 ? half : to.points.size()); i += stride) {
      points.push_back(to.points[i]);
    }
    pose[k] = register_fine(from, points, from_from_to);
    const double whole = agreement(from.cloud, points, from_from_to);
    const double own = pose[k].is_finite() ? agreement(from.cloud, points, pose[k]) : 0.0;
    seen = std::max({seen, whole, own});
    if (own < kInView || own < kBetter * whole) pose[k] = from_from_to;
  }
  return {to_from_middle.inverse() * pose[0].inverse() * pose[1] * to_from_middle,
          interpolate(pose[0] * to_from_middle, pose[1] * to_from_middle, 0.5) * to_from_middle.inverse(),
          seen};
}

}  // namespace hp2
