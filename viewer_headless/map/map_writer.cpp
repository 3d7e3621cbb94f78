#include "viewer_headless/map/map_writer.hpp"

#include <cmath>
#include <fstream>
#include <vector>

#include "common/error.hpp"

namespace hp2 {

namespace {

constexpr std::size_t kBufferPoints = 1 << 16;
constexpr std::size_t kHeaderBytes = 256;

// A header of always the same length, so that it can be written first and get its count last: a comment fills
// it up.
std::string padded(const std::string& before, const std::string& comment, const std::string& after) {
  const std::size_t used = before.size() + comment.size() + 1 + after.size();
  return before + comment + std::string(kHeaderBytes - used, '.') + "\n" + after;
}

std::string ply_header(std::int64_t count) {
  return padded("ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) +
                    "\nproperty float x\nproperty float y\nproperty float z\n",
                "comment HP2-SLAM map, metres ", "end_header\n");
}

std::string pcd_header(std::int64_t count) {
  const std::string n = std::to_string(count);
  return padded("# .PCD v0.7 - Point Cloud Data file format\n", "# HP2-SLAM map, metres ",
                "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH " + n +
                    "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + n + "\nDATA binary\n");
}

}  // namespace

bool VoxelSet::insert(const Eigen::Vector3d& point) {
  if (voxel_m_ <= 0.0) return true;
  std::uint64_t key = 0;
  std::array<std::uint64_t, 3> in_block{};
  for (int k = 0; k < 3; ++k) {
    const double cell = std::floor(point[k] / voxel_m_);
    constexpr double kMost = double(1 << 23);  // 2^20 blocks of 8
    if (!(std::abs(cell) < kMost)) return false;
    const auto index = static_cast<std::uint64_t>(static_cast<std::int64_t>(cell) + (std::int64_t{1} << 23));
    key = key << 21 | index >> 3;
    in_block[k] = index & 7;
  }
  // Neighbours in a submap are mostly in one block.
  if (blocks_.empty() || key != last_key_) {
    const auto [it, is_new] = numbers_.try_emplace(key, static_cast<std::uint32_t>(blocks_.size()));
    if (is_new) blocks_.push_back({});
    last_key_ = key;
    last_ = it->second;
  }
  std::uint64_t& layer = blocks_[last_][in_block[2]];
  const std::uint64_t bit = std::uint64_t{1} << (in_block[1] * 8 + in_block[0]);
  const bool is_new = (layer & bit) == 0;
  layer |= bit;
  return is_new;
}

MapWriter::MapWriter(const std::string& folder, double voxel_m)
    : seen_(voxel_m),
      ply_(folder + "/map.ply"),
      pcd_(folder + "/map.pcd"),
      ply_header_(ply_header(0)),
      pcd_header_(pcd_header(0)) {
  ply_.write(ply_header_);
  pcd_.write(pcd_header_);
  buffer_.reserve(3 * kBufferPoints);
}

void MapWriter::add(const Eigen::Vector3d& point) {
  if (!seen_.insert(point)) return;
  for (int k = 0; k < 3; ++k) buffer_.push_back(static_cast<float>(point[k]));
  ++count_;
  if (buffer_.size() == 3 * kBufferPoints) write_buffer();
}

void MapWriter::write_buffer() {
  ply_.write(buffer_.data(), buffer_.size() * sizeof(float));
  pcd_.write(buffer_.data(), buffer_.size() * sizeof(float));
  buffer_.clear();
}

void MapWriter::for_each(const std::function<void(const Eigen::Vector3f&)>& visit) {
  write_buffer();
  ply_.flush();
  std::ifstream file(ply_.temporary_path(), std::ios::binary);
  file.seekg(static_cast<std::streamoff>(ply_header_.size()));
  std::vector<Eigen::Vector3f> chunk(kBufferPoints);
  for (std::int64_t left = count_; left > 0;) {
    const std::int64_t n = std::min<std::int64_t>(left, static_cast<std::int64_t>(chunk.size()));
    if (!file.read(reinterpret_cast<char*>(chunk.data()),
                   n * static_cast<std::streamoff>(sizeof(Eigen::Vector3f)))) {
      throw Error("the map cannot be read back", ply_.temporary_path(),
                  "Check the disk, then write it again.");
    }
    for (std::int64_t i = 0; i < n; ++i) visit(chunk[static_cast<std::size_t>(i)]);
    left -= n;
  }
}

void MapWriter::commit() {
  write_buffer();
  ply_.patch(0, ply_header(count_));
  pcd_.patch(0, pcd_header(count_));
  ply_.commit();
  pcd_.commit();
}

}  // namespace hp2
