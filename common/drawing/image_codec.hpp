// Pictures as the content of files. OpenCV's own encoders would bring GDAL and a hundred other libraries into
// the process: a tenth of a second of a processor at every start.
#pragma once
#include <string>

#include <opencv2/core.hpp>

namespace hp2 {

/// @param bgr 8 bits a channel, not empty
std::string encode_png(const cv::Mat& bgr);
/// @param quality 1..100
std::string encode_jpeg(const cv::Mat& bgr, int quality);

}  // namespace hp2
