#include "backend/places/features.hpp"

#include <cstring>

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>

namespace hp2 {
namespace {

constexpr int kPatch = 31;
// ORB looks for no corner nearer to the image's border than this: an empty margin of that width loses none.
constexpr int kMargin = kPatch;

// Marks the features that look like another one.
HP2_COUNTS_BITS void mark_repeated(const Descriptor* all, std::size_t n, int bits, char* repeated) {
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i + 1; j < n; ++j) {
      if (hamming_distance(all[i], all[j]) <= bits) repeated[i] = repeated[j] = 1;
    }
  }
}

}  // namespace

Features extract_features(const DensityImage& image, const BackendConfig& config) {
  Features result;
  if (image.pixels.empty()) return result;
  cv::Mat padded = cv::Mat::zeros(image.height + 2 * kMargin, image.width + 2 * kMargin, CV_8UC1);
  for (int v = 0; v < image.height; ++v) {
    std::memcpy(padded.ptr(v + kMargin) + kMargin, &image.pixels[static_cast<std::size_t>(v) * image.width],
                static_cast<std::size_t>(image.width));
  }
  const auto orb = cv::ORB::create(config.features, 1.0F, 1, kPatch, 0, 2, cv::ORB::FAST_SCORE, kPatch,
                                   config.fast_threshold);
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat rows;
  orb->detectAndCompute(padded, cv::noArray(), keypoints, rows);

  std::vector<Descriptor> all(keypoints.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    std::memcpy(all[i].data(), rows.ptr(static_cast<int>(i)), sizeof(Descriptor));
  }
  std::vector<char> repeated(all.size(), 0);
  mark_repeated(all.data(), all.size(), config.self_similar_bits, repeated.data());
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (repeated[i]) continue;
    const Eigen::Vector2d cell(keypoints[i].pt.x - kMargin + 0.5, keypoints[i].pt.y - kMargin + 0.5);
    result.keypoints.push_back((image.min_m + image.cell_m * cell).cast<float>());
    result.descriptors.push_back(all[i]);
  }
  return result;
}

}  // namespace hp2
