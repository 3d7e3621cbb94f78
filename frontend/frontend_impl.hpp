// What a Frontend is made of; for frontend.cpp and frontend_guesses.cpp only.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "frontend/adaptive_scale.hpp"
#include "frontend/frontend.hpp"
#include "frontend/hybrid_icp.hpp"
#include "frontend/local_map.hpp"
#include "frontend/motion_model.hpp"
#include "frontend/parallel.hpp"
#include "frontend/preprocess.hpp"
#include "frontend/submap_builder.hpp"

namespace hp2 {

class Frontend::Impl {
 public:
  Impl(const FrontendConfig& config, int threads)
      : config_(config),
        parallel_(threads),
        preprocessor_(
            {config.min_range_m, config.max_range_m, config.map_point_voxel_m, config.source_voxel_m}),
        map_(config.voxel_size_m, config.max_points_per_voxel, config.min_spacing_m),
        icp_(icp_config(config)),
        scale_(config.initial_sigma_m, config.min_sigma_m, config.sigma_window),
        builder_(config.submap_voxel_m) {
    validate(config);
  }

  FrontendOutput process(const Scan& scan);
  std::optional<Submap> finish() { return builder_.finish(); }
  std::vector<std::uint8_t> save_state() const;
  void restore_state(const std::vector<std::uint8_t>& state);
  std::vector<std::string> take_warnings() { return std::exchange(warnings_, {}); }

 private:
  bool usable_times(const Scan& scan);
  void warn_once(unsigned bit, const std::string& text);
  void deskew(const Vector6d& sweep_twist);
  void deskewed(const PreprocessedScan& cloud, const Vector6d& sweep_twist,
                std::vector<Eigen::Vector3f>& out) const;
  double submap_length_m() const;
  // frontend_guesses.cpp
  bool astray(std::int64_t utime, double sigma, IcpResult& icp);
  void look_farther(std::int64_t utime, IcpResult& icp, double sigma, const PosePrior& prior);
  void search_around(IcpResult& icp, double sigma, const PosePrior& prior);
  void begin_anew();
  IcpResult moving_start(const Scan& scan, double sigma);
  IcpResult settle_start(const Scan& scan, IcpResult icp, double sigma, HybridIcp& aligner);

  FrontendConfig config_;
  Parallel parallel_;
  Preprocessor preprocessor_;
  LocalMap map_;
  HybridIcp icp_;
  AdaptiveScale scale_;
  MotionModel motion_;
  SubmapBuilder builder_;
  std::int64_t last_sequence_ = -1;
  double seen_range_m_ = 100.0;  // RMS distance of the last registered points
  bool moved_ = false;
  double usual_fit_ = 1.0;                                // running mean of IcpResult::fit
  Eigen::Vector3d evicted_at_ = Eigen::Vector3d::Zero();  // where the map was last cut to its radius
  unsigned warned_ = 0;
  std::vector<std::string> warnings_;

  // Buffers kept from scan to scan.
  PreprocessedScan cloud_;
  PreprocessedScan first_cloud_;  // of the first scan, until the second has told how fast the sensor was then
  std::vector<Eigen::Vector3f> points_, source_;
};

}  // namespace hp2
