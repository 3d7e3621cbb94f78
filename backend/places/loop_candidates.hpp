// Which pairs of submaps may be the same place: by their appearance from above, and by their positions in the
// graph.
#pragma once
#include <cstdint>
#include <utility>
#include <vector>

#include "backend/backend_config.hpp"
#include "backend/closures/closure_verifier.hpp"
#include "backend/places/features.hpp"
#include "backend/places/ground_alignment.hpp"
#include "backend/places/hamming_tree.hpp"
#include "common/session.hpp"
#include "common/submap.hpp"

namespace hp2 {

/// Description of a submap for finding it again. Kept in memory, without points.
struct Place {
  GroundAlignment ground;
  std::vector<Eigen::Vector2f> keypoints;  ///< Ground-aligned frame [m].
  std::vector<Eigen::Vector3d> path;       ///< Sensor positions [m], submap frame, thinned.
  double path_begin_m = 0.0;               ///< Distance travelled since the session began, at the keypose
  double path_end_m = 0.0;                 ///< and at the submap's end.
  double doubtful_m = 0.0;  ///< Additional length for degenerate scans, whose motion may be wrong.
  std::int32_t piece = 0;   ///< Number of losses of tracking before the keypose; the same if connected.
  bool ends_piece = false;  ///< Tracking was lost between this keypose and the next one, at this one's side.
  double seen_radius_m = 0.0;  ///< Median distance of the points from the path.
};

/// The place of a submap, and its features for the tree. Of a submap in which tracking was lost, the anchored
/// part (pieces.hpp).
/// @param before the place of the submap before; null: there is none
std::pair<Place, Features> make_place(const Submap& submap, const Place* before, const BackendConfig& config);

/// Bytes for the session store: a place and its features.
std::vector<std::uint8_t> encode_place(const Place& place, const Features& features);
/// @throws Error for damaged bytes
std::pair<Place, Features> decode_place(const std::vector<std::uint8_t>& bytes, const std::string& where);

/// A pair to be checked in 3D.
struct Candidate {
  std::int64_t from = 0;             ///< Older submap.
  Pose guess;                        ///< from_from_to.
  int inliers = 0;                   ///< Of the 2D alignment; 0: proposed by the graph.
  double max_path_distance_m = 0.0;  ///< Paths further apart than this are no revisit.
  bool rivals = false;               ///< Another place looks as much like it.
};

/// All places of a session with their features.
class PlaceIndex {
 public:
  explicit PlaceIndex(const BackendConfig& config) : config_(config) {}
  /// The place becomes the newest one; it can be taken back until its features are added.
  void add_place(Place place) { places_.push_back(std::move(place)); }
  void remove_newest_place() { places_.pop_back(); }
  /// Makes the newest place findable.
  void add_features(const Features& features);
  const std::vector<Place>& places() const { return places_; }
  const HammingTree& tree() const { return tree_; }

  /// Largest distance of two paths for the pair to be a revisit [m]; 0: the pair is no candidate.
  /// `adaptive`: the sensor must have left what it saw (by its own seen radius), and come back to much nearer
  /// than the distance travelled between.
  double revisit_distance(std::int64_t from, std::int64_t to) const;

  /// Older places that look like the newest one, whose features are these and not yet added; best first.
  std::vector<Candidate> alike(const Features& features) const;

  /// Older places that submap `to` has come back to according to the graph, nearest first.
  /// @param distances graph_distances() from `to`
  std::vector<Candidate> near(std::int64_t to, const std::vector<Pose>& map_from_submap,
                              const std::vector<double>& distances) const;

 private:
  BackendConfig config_;
  std::vector<Place> places_;
  HammingTree tree_;
};

/// Length of the shortest path [m] through odometry and accepted closures from submap `start` to every
/// submap, for the drift bound. Infinite where tracking was lost on every path.
std::vector<double> graph_distances(const std::vector<Place>& places,
                                    const std::vector<ClosureRecord>& closures, std::int64_t start);

/// Bound on the error of the graph's relative pose after `distance_m` through the graph: the credible drift,
/// larger where many features agree; none if the distance is infinite.
/// @param inliers of the images' alignment; 0: none
PoseBound drift_bound(const Pose& from_from_to, double distance_m, int inliers, const BackendConfig& config);

}  // namespace hp2
