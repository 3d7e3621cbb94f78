#include "common/drawing/image_codec.hpp"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

namespace hp2 {
namespace {

cv::Mat decoded(const std::string& bytes) {
  return cv::imdecode(std::vector<char>(bytes.begin(), bytes.end()), cv::IMREAD_COLOR);
}

// A gradient with a sharp edge and noise in its lower half, of an odd size.
cv::Mat picture() {
  cv::Mat image(67, 131, CV_8UC3);
  cv::theRNG().state = 7;
  for (int r = 0; r < image.rows; ++r) {
    for (int c = 0; c < image.cols; ++c) {
      const int noise = r > 40 ? cv::theRNG().uniform(0, 40) : 0;
      image.at<cv::Vec3b>(r, c) = {cv::saturate_cast<uchar>(c + noise),
                                   cv::saturate_cast<uchar>(3 * r + noise),
                                   static_cast<uchar>(c > 60 ? 220 : 10)};
    }
  }
  return image;
}

TEST(ImageCodec, PngKeepsEveryPixel) {
  for (const cv::Mat& image : {picture(), cv::Mat(1, 1, CV_8UC3, cv::Scalar(1, 2, 3))}) {
    const cv::Mat again = decoded(encode_png(image));
    ASSERT_EQ(again.size(), image.size());
    EXPECT_EQ(cv::norm(again, image, cv::NORM_INF), 0.0);
  }
  EXPECT_LT(encode_png(cv::Mat(500, 500, CV_8UC3, cv::Scalar(13, 17, 23))).size(), 5000U);
}

TEST(ImageCodec, JpegComesNear) {
  const cv::Mat image = picture(), again = decoded(encode_jpeg(image, 95));
  ASSERT_EQ(again.size(), image.size());
  EXPECT_LT(cv::norm(again, image, cv::NORM_L1) / static_cast<double>(3 * image.total()), 6.0);
}

}  // namespace
}  // namespace hp2
