// Adaptive hybrid ICP (paper, sec. "Problem Formulation"): point-to-plane where the map is planar,
// point-to-point where it is not, balanced by alpha. Geman-McClure loss with c = sigma, Gauss-Newton on
// se(3).
#pragma once
#include <array>
#include <cstdint>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "common/geometry/pose.hpp"
#include "common/registration/local_map.hpp"
#include "common/registration/normal_equations.hpp"
#include "common/registration/parallel.hpp"
#include "common/registration/residual_batch.hpp"

namespace hp2 {

/// Which residuals are used and how they are balanced.
enum class IcpMode {
  kHybrid,          ///< The paper's: alpha = |P| / (|P| + |Q|), tau(n).
  kPointToPoint,    ///< All correspondences point-to-point.
  kPointToPlane,    ///< All correspondences with a normal point-to-plane.
  kFixedAlpha,      ///< As hybrid with alpha = 0.5.
  kFixedThreshold,  ///< As hybrid with tau = tau_ref whatever n.
};

/// Settings of the registration.
struct IcpConfig {
  IcpMode mode = IcpMode::kHybrid;
  double tau_ref = 0.2, n_ref = 27.0, tau_min = 0.05, tau_max = 0.3;
  int n_min = 5;
  int max_iterations = 30;
  double convergence_m = 3e-3;  ///< Ends when a step's translation [m] and rotation [rad] norm is below this.
  /// While steps are longer than this [m, rad], some 800 of the source points are registered; 0: always all.
  double coarse_step_m = 0.02;
  bool weak_directions =
      false;  ///< Supports weakly observed directions by planar points' in-plane residuals,
  double in_plane_weight = 0.3;        ///< of this weight,
  double weak_direction_ratio = 0.03;  ///< where the eigenvalue is below this share of the largest.
  bool two_sides = false;   ///< Keeps a planar point to the side of the surface that it is seen from.
  bool scan_lines = false;  ///< No normal where the neighbourhood is a line that the sensor may have drawn.
  bool refinement = false;  ///< refine() follows: align() may end a little earlier.
  double min_eigenvalue_ratio =
      1e-4;  ///< Directions below this share of the largest eigenvalue are not observed.
};

/// Scales c of the robust loss, one per kind of residual [m].
struct ResidualScales {
  double planar_m = 0.0, point_m = 0.0;

  /// Narrower scales: not much wider than the RMS residuals of `sums`, which were taken with these.
  ResidualScales narrowed(const NormalEquations& sums) const;
};

/// Outcome of one registration.
struct IcpResult {
  Pose map_from_source;
  Matrix6d information =
      Matrix6d::Zero();  ///< Gauss-Newton matrix over the residuals' variance; left increments about the
                         ///< source's origin, (rho [m], phi [rad]), axes of the map.
  int n_planar = 0, n_non_planar = 0;
  int iterations = 0;
  bool converged = false;
  double rms_m = 0.0;
  double mean_range_m = 0.0;  ///< RMS distance of the source points from their origin.
  double fit = 0.0;           ///< Soft share of source points within half a voxel of a map point, 0..1.
  double inlier_ratio = 0.0;  ///< Correspondences within 3 sigma over source points.
  double min_eigenvalue_ratio = 0.0;
  int unobserved_directions = 0;
  double ms_search = 0.0, ms_planarity = 0.0, ms_solve = 0.0;

  /// Adds the work of the registration that this one continues.
  void add_work(const IcpResult& before) {
    iterations += before.iterations;
    ms_search += before.ms_search;
    ms_planarity += before.ms_planarity;
    ms_solve += before.ms_solve;
  }
  double alpha() const {
    const int n = n_planar + n_non_planar;
    return n > 0 ? static_cast<double>(n_planar) / n : 0.0;
  }
};

/// Registers clouds to a local map. Keeps its buffers from call to call.
class HybridIcp {
 public:
  explicit HybridIcp(const IcpConfig& config) : config_(config) {}

  const IcpConfig& config() const { return config_; }
  /// Iterations of a registration at most, from now on.
  void set_max_iterations(int n) { config_.max_iterations = n; }
  /// From now on, lengthens steps that keep their direction up to three times, with at most 15 iterations.
  /// For an initialisation: its prediction may be off by many steps along a weakly observed direction.
  void set_accelerated(bool on) { accelerated_ = on; }

  /// @param map    its planarity cache is brought up to date where it is needed
  /// @param source [m], sensor frame, deskewed
  /// @param guess  map_from_source to begin with
  /// @param sigma_m scale of the robust loss; correspondences beyond 3 sigma are rejected
  IcpResult align(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                  double sigma_m, const Parallel& parallel);
  /// The same for the points of the last align() after they have moved a little (deskewed again), while the
  /// map is unchanged. Correspondences that are still valid are kept.
  IcpResult align_again(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                        double sigma_m, const Parallel& parallel);
  /// The last few iterations, from a pose that is nearly right, in well observed directions only. The scale
  /// is as narrow as the residuals, whatever sigma is, so outliers have no weight. With a wide scale,
  /// surfaces that the map does not hold yet lie on one side of those that it holds, and bias the pose.
  IcpResult refine(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                   double sigma_m, const Parallel& parallel);
  /// Source points on surfaces which the map knows from the other side
  /// (LocalMap::insert_other_side()), by index, with the surface's unit normal, axes of the map.
  /// @param result of the last align(), align_again() or refine(); none for another one, whose points lay
  ///               elsewhere
  void turned_points(const IcpResult& result,
                     std::vector<std::pair<std::uint32_t, Eigen::Vector3f>>& out) const;
  /// Soft share of source points within about 0.2 m of the map's surface, 0..1, from about 1,500 of them.
  /// Unlike IcpResult::fit it does not depend on sigma. Call it before the points are added to the map;
  /// align_again() cannot follow it.
  double agreement(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& map_from_source,
                   const Parallel& parallel);

 private:
  struct Correspondence {
    Eigen::Vector3f searched_at;   // query position of the last search, from the local origin [m]
    Eigen::Vector3f target;        // nearest map point, from the local origin [m]
    Eigen::Vector3f normal;        // of the target's neighbourhood; zero: not planar
    float other_distance = -1.0F;  // as NearestPoint; negative: never searched
    std::int32_t voxel = -1;
    std::int16_t slot = 0;  // of the target in its voxel
    // two_sides: the nearest point was seen from the surface's other side; and there is none on this side.
    bool turned = false, hidden = false;
    // scan_lines: the neighbourhood is a line; and one that the sensor may have drawn itself.
    bool line = false, scan_line = false;
    float seen_from_m = 0.0F;  // distance from which the map saw the target; 0: not known
  };
  // Results of one iteration for a block of source points.
  struct Part {
    NormalEquations sums;
    std::vector<std::uint32_t> fresh;     // correspondences found by this iteration's search
    std::vector<LocalMap::Probe> probes;  // its queries
    std::vector<std::pair<std::int32_t, Planarity>> planarities;  // computed for voxels where it was stale
    std::array<std::uint32_t, 128> recent{};                      // of these, by voxel: the last one
    float ms[3] = {};                                             // search, planarity, sums
  };
  // One iteration's source points: every `stride`-th of them.
  struct Selection {
    const std::vector<Eigen::Vector3f>& points;
    std::size_t stride, begin, end;
  };

  IcpResult iterate(LocalMap& map, const std::vector<Eigen::Vector3f>& source, const Pose& guess,
                    double sigma_m, const Parallel& parallel, bool refining);
  NormalEquations linearise(LocalMap& map, const std::vector<Eigen::Vector3f>& source, std::size_t stride,
                            const Pose& local_from_source, double sigma_m, const Parallel& parallel,
                            IcpResult& result);
  void search(const LocalMap& map, const Selection& source, const Pose& local_from_source, Part& part);
  static const Planarity& shape_of(const LocalMap& map, std::int32_t voxel, Part& part);
  void classify(const LocalMap& map, const Pose& local_from_source, Part& part);
  void look_on_this_side(const LocalMap& map, const Eigen::Vector3f& sensor, Correspondence& c) const;
  void accumulate(const Selection& source, const Pose& local_from_source, double sigma_m, Part& part) const;
  bool narrow_scales();
  double support_weak_directions(const NormalEquations& sums, double lever, Matrix6d& information,
                                 Vector6d& gradient);
  Matrix6d balance(const NormalEquations& sums, Vector6d& gradient) const;

  IcpConfig config_;
  bool accelerated_ = false, refining_ = false;
  Voxel3i origin_ = Voxel3i::Zero();  // voxel whose corner is the local origin
  std::vector<Correspondence> correspondences_;
  Pose outcome_;  // to which they belong
  std::vector<Part> parts_;
  // Scales of the robust loss [m], and what the last iteration has summed with them.
  ResidualScales scales_;
  float fit2_ = 0.0F;  // [m^2], squared scale of IcpResult::fit
  NormalEquations sums_;
  float margin_m_ = 0.0F;         // of the present searches (LocalMap::nearest)
  bool in_plane_needed_ = false;  // by a weak direction of the present registration
};

}  // namespace hp2
