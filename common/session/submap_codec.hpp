// Submaps and poses as bytes, for the session store: little-endian, with a checksum at the end.
#pragma once
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// Appends values to a byte string.
class BlobWriter {
 public:
  template <class T>
  void put(const T& value) {
    std::memcpy(room(sizeof(T)), &value, sizeof(T));
  }
  void put_pose(const Pose& pose);
  void put_matrix(const Matrix6d& matrix);
  void put_text(const std::string& text);
  /// Room for `n` bytes more, to be filled before anything else is put.
  std::uint8_t* room(std::size_t n) {
    bytes_.resize(bytes_.size() + n);
    return bytes_.data() + (bytes_.size() - n);
  }
  /// The bytes with their checksum appended.
  std::vector<std::uint8_t> finish();

 private:
  std::vector<std::uint8_t> bytes_;
};

/// Reads back what BlobWriter wrote.
class BlobReader {
 public:
  /// @param where what is read, for the message. @throws DamageError if the checksum does not fit. That of
  /// sessions of versions 1 and 2 is known, too.
  BlobReader(const std::vector<std::uint8_t>& bytes, std::string where);
  template <class T>
  T get() {
    T value;
    take(&value, sizeof(T));
    return value;
  }
  Pose get_pose();
  Matrix6d get_matrix();
  std::string get_text();
  /// The next `n` bytes. @throws DamageError if there are fewer
  const std::uint8_t* skip(std::size_t n);
  std::size_t left() const { return end_ - at_; }

 private:
  void take(void* to, std::size_t n);
  const std::vector<std::uint8_t>& bytes_;
  std::string where_;
  std::size_t at_ = 0, end_ = 0;
};

/// Points (float), normals (int8, unit = 127) and scan indices (uint32): 19 bytes per point.
std::vector<std::uint8_t> encode_points(const Submap& submap);
/// Fills points, normals and scan_indices. Normals come back within 1/127 of what was stored, and as the same
/// bits if they come from here or from a decoded submap_t.
/// @throws DamageError for damaged bytes
void decode_points(const std::vector<std::uint8_t>& bytes, const std::string& where, Submap& submap);

/// All scans with poses, covariances, states and diagnostics; exact.
std::vector<std::uint8_t> encode_scans(const std::vector<ScanPose>& scans);
/// @throws DamageError for damaged bytes
std::vector<ScanPose> decode_scans(const std::vector<std::uint8_t>& bytes, const std::string& where);

/// Final poses of one submap's scans; exact.
std::vector<std::uint8_t> encode_final_poses(const std::vector<TrajectoryPose>& poses);
/// @param submap the one whose scans they are
std::vector<TrajectoryPose> decode_final_poses(const std::vector<std::uint8_t>& bytes,
                                               const std::string& where, std::int64_t submap);

/// Poses as given, 56 bytes each; exact.
std::vector<std::uint8_t> encode_poses(const std::vector<Pose>& poses);
/// @throws DamageError for damaged bytes
std::vector<Pose> decode_poses(const std::vector<std::uint8_t>& bytes, const std::string& where);

}  // namespace hp2
