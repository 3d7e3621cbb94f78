// What evo_ape, evo_rpe and the KITTI odometry devkit compute, to the last printed digit.
#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "common/evaluation/trajectory.hpp"

namespace hp2 {

/// Statistics of a list of errors; all 0 for an empty list. `std` is the population's.
struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, std = 0, min = 0, max = 0, sse = 0;
  std::size_t n = 0;
};
ErrorStatistics statistics(const std::vector<double>& errors);

/// How the estimate is moved onto the reference before absolute errors are taken.
enum class Alignment {
  kSe3,     ///< Least squares over all positions (Umeyama without scale): evo_ape -a.
  kOrigin,  ///< First pose on first pose: evo_ape --align_origin.
  kNone,    ///< Not at all: evo_ape.
};
/// "se3", "origin" or "none". @throws Error naming the nearest known word
Alignment parse_alignment(const std::string& word);

/// reference_from_estimate of paired positions [m] by Umeyama's closed form without scale.
/// @throws Error for fewer than 3 pairs, or positions that lie on one line or point (the rotation is not
/// determined)
Eigen::Matrix4d umeyama_se3(const std::vector<Eigen::Vector3d>& reference,
                            const std::vector<Eigen::Vector3d>& estimate);

/// The transform that `alignment` stands for. Pairs of one length, at least one. Where SE(3) alignment is not
/// determined, as umeyama_se3.
Eigen::Matrix4d alignment_transform(const Trajectory& reference, const Trajectory& estimate,
                                    Alignment alignment);

/// The estimate with `transform` applied on the left.
Trajectory transformed(const Eigen::Matrix4d& transform, const Trajectory& trajectory);

/// Absolute position errors [m], one a pair, without alignment.
std::vector<double> absolute_errors(const Trajectory& reference, const Trajectory& estimate);

/// Relative errors over `delta` poses.
struct RelativeErrors {
  std::vector<double> translation_m;
  std::vector<double> rotation_deg;
};
/// @param all_pairs pairs (i, i + delta) for every i (evo_rpe --all_pairs); otherwise for every delta-th i
RelativeErrors relative_errors(const Trajectory& reference, const Trajectory& estimate, std::size_t delta = 1,
                               bool all_pairs = false);

/// The KITTI odometry metric: mean relative error over all segments of 100, 200, ..., 800 m of the
/// reference's path.
struct KittiError {
  double t_percent = 0;       ///< Translation error [%]; not a number if there is no segment.
  double r_deg_per_100m = 0;  ///< Rotation error [degrees / 100 m]; not a number if there is no segment.
  std::size_t segments = 0;
};
/// @param step every so many poses a segment begins: 10 in the devkit
KittiError kitti_error(const Trajectory& reference, const Trajectory& estimate, std::size_t step = 10);

/// All metrics of one estimate.
struct Evaluation {
  ErrorStatistics ate;              ///< [m], after alignment.
  ErrorStatistics rpe_translation;  ///< [m]
  ErrorStatistics rpe_rotation_deg;
  KittiError kitti;
  std::vector<double> ate_errors;  ///< [m], one a pair.
  Trajectory reference, aligned;   ///< The pairs, the estimate after alignment.
};
/// @param rpe_delta poses between the two ends of a relative error
Evaluation evaluate(const Trajectory& reference, const Trajectory& estimate, Alignment alignment,
                    std::size_t rpe_delta = 1);

/// {"ate": {"rmse", "mean", "median", "std", "min", "max", "sse", "n"}, "rpe_translation": {...},
///  "rpe_rotation_deg": {...}, "kitti": {"t_percent", "r_deg_per_100m", "segments"}}; no segment: null.
nlohmann::ordered_json to_json(const Evaluation& evaluation);

}  // namespace hp2
