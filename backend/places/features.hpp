// ORB features of a density image: what a place looks like from above, in 256 bits a corner.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "backend/backend_config.hpp"
#include "backend/places/density_image.hpp"

namespace hp2 {

/// Before a function that counts bits in its inner loop: on x86-64 it is compiled with and without the POPCNT
/// instruction, which the baseline has not, and chosen when the program starts. Other processors always have
/// one. (The thread sanitizer cannot: the choice is made before it is ready.)
#if defined(__x86_64__) && !defined(__SANITIZE_THREAD__)
#define HP2_COUNTS_BITS __attribute__((target_clones("popcnt", "default")))
#else
#define HP2_COUNTS_BITS
#endif

/// 256 bits of an ORB descriptor.
using Descriptor = std::array<std::uint64_t, 4>;

/// Bits in which two descriptors differ, 0..256.
inline int hamming_distance(const Descriptor& a, const Descriptor& b) {
  return __builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) +
         __builtin_popcountll(a[2] ^ b[2]) + __builtin_popcountll(a[3] ^ b[3]);
}

/// Features of one place, one keypoint a descriptor.
struct Features {
  std::vector<Eigen::Vector2f> keypoints;  ///< In the ground-aligned frame [m].
  std::vector<Descriptor> descriptors;
};

/// ORB on one level with patch 31. Of features that look like another one of the same image (repeated
/// structure) none is kept.
Features extract_features(const DensityImage& image, const BackendConfig& config);

}  // namespace hp2
