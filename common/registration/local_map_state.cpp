// The local map as a whole: moved, saved and read back.
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "common/registration/local_map.hpp"
#include "common/registration/local_map_blocks.hpp"

namespace hp2 {

using namespace map_blocks;

void LocalMap::move(const Pose& by) {
  LocalMap moved(voxel_size_, static_cast<int>(capacity_), min_spacing_, wide_);
  copy_points(moved, by);
  *this = std::move(moved);
}

void LocalMap::copy_points(LocalMap& moved, const Pose& by) const {
  for_each_voxel([&](std::int32_t i) {
    for (std::int32_t s = 0; s < count(i); ++s) {
      const VoxelPoint at = moved.locate(by * point(i, s));
      const std::int32_t v = moved.voxel_at(at.voxel);
      if (!moved.has_room(v, at.offset)) continue;
      View turned = quantised(by.rotation * view(i, s).cast<double>());
      turned[3] = view_of(i, s)[3];
      moved.add_point(v, at.offset, turned);
    }
  });
}

void LocalMap::save(ByteWriter& out) const {
  constexpr std::size_t kHead = sizeof(Voxel3i) + sizeof(std::int32_t),
                        kPoint = sizeof(Eigen::Vector3f) + sizeof(View);
  out.reserve(sizeof(std::uint64_t) + voxel_count() * kHead + point_count_ * kPoint);
  out.put(static_cast<std::uint64_t>(voxel_count()));
  std::vector<std::uint8_t> bytes(kHead + capacity_ * kPoint);  // of a voxel
  for_each_voxel([&](std::int32_t i) {
    const std::int32_t n = count(i);
    std::memcpy(bytes.data(), voxels_[static_cast<std::size_t>(i)].coordinates.data(), sizeof(Voxel3i));
    std::memcpy(bytes.data() + sizeof(Voxel3i), &n, sizeof n);
    std::uint8_t* to = bytes.data() + kHead;
    for (std::int32_t s = 0; s < n; ++s, to += kPoint) {
      const Eigen::Vector3f offset = point_offset(i, s);
      std::memcpy(to, offset.data(), sizeof offset);
      const View& view = view_of(i, s);
      std::memcpy(to + sizeof offset, view.data(), sizeof view);
    }
    out.put(bytes.data(), static_cast<std::size_t>(to - bytes.data()));
  });
}

void LocalMap::load(ByteReader& in) {
  *this = LocalMap(voxel_size_, static_cast<int>(capacity_), min_spacing_, wide_);
  const auto n_voxels = in.take<std::uint64_t>();
  for (std::uint64_t i = 0; i < n_voxels; ++i) {
    const auto coordinates = in.take<Voxel3i>();
    const auto n_points = in.take<std::int32_t>();
    const bool within = coordinates.minCoeff() > -kReach && coordinates.maxCoeff() < kReach;
    if (!within || n_points < 1 || static_cast<std::size_t>(n_points) > capacity_)
      in.fail("local map, voxel " + std::to_string(i));
    const std::int32_t v = voxel_at(coordinates);
    if (count(v) > 0) in.fail("local map, voxel " + std::to_string(i));
    for (std::int32_t s = 0; s < n_points; ++s) {
      const auto offset = in.take<Eigen::Vector3f>();
      // Offsets lie in the voxel, up to the rounding of far coordinates.
      const auto margin = static_cast<float>(1e-3 * voxel_size_);
      if (!(offset.allFinite() && offset.minCoeff() >= -margin &&
            offset.maxCoeff() <= static_cast<float>(voxel_size_) + margin))
        in.fail("local map, voxel " + std::to_string(i));
      add_point(v, offset, in.take<View>());
    }
  }
}

}  // namespace hp2
