#include "backend/places/loop_candidates.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "backend/graph/pieces.hpp"
#include "backend/places/density_image.hpp"
#include "backend/places/ransac_2d.hpp"
#include "common/session/submap_codec.hpp"

namespace hp2 {
namespace {

constexpr double kPathSpacing = 2.0;              // [m] between the remembered points of a path
constexpr double kReach = 25.0;                   // [m] paths further apart see too little of the same
constexpr double kMinGap = 12.0, kMaxGap = 60.0;  // [m] bounds of the distance travelled between two visits
constexpr double kNoLimit = 1e9;
// Length through the graph [m] after which a good odometry is still within the registration's reach.
constexpr double kKnownWithin = 500.0;
constexpr double kComeBack = 0.5;            // largest distance of a revisit, share of the distance travelled
constexpr double kClosureLength = 1.0;       // [m] length of a closure in the graph
constexpr double kDegenerateFactor = 3.0;    // length of a degenerate metre
constexpr double kBoundFloor = 1.0;          // [m]
constexpr double kRotationBoundFloor = 0.2;  // [rad]
constexpr double kRotationBoundGrowth = 5e-4;  // [rad / m]
// So many matches do not agree by chance: odometry's bound is widened, but not dropped, because a bridge
// repeats itself exactly.
constexpr int kManyInliers = 20;
constexpr double kDoubt = 3.0;
constexpr std::size_t kMaxAligned = 10;  // submaps whose matches are aligned in 2D

double seen_radius(const Submap& submap, const std::vector<Eigen::Vector3d>& path) {
  std::vector<double> distances;
  const std::size_t stride = std::max<std::size_t>(1, submap.points.size() / 2000);
  for (std::size_t i = 0; i < submap.points.size(); i += stride) {
    double best = 1e18;
    for (const auto& p : path) best = std::min(best, (submap.points[i].cast<double>() - p).squaredNorm());
    distances.push_back(std::sqrt(best));
  }
  if (distances.empty()) return 0.0;
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return *middle;
}

double doubtful_way(const Submap& submap) {
  double sum = 0.0;
  Pose previous;
  for (const ScanPose& s : submap.scans) {
    const double step = (previous.inverse() * s.submap_from_sensor).translation.norm();
    if (s.state == TrackingState::kDegenerate) sum += (kDegenerateFactor - 1.0) * step;
    previous = s.submap_from_sensor;
  }
  return sum;
}

Pose lifted(const Place& from, const Place& to, const Alignment2d& a) {
  const Pose ground_from_ground({std::cos(0.5 * a.angle), 0.0, 0.0, std::sin(0.5 * a.angle)},
                                {a.translation.x(), a.translation.y(), 0.0});
  return from.ground.ground_from_submap.inverse() * ground_from_ground * to.ground.ground_from_submap;
}

}  // namespace

std::pair<Place, Features> make_place(const Submap& whole, const Place* before, const BackendConfig& config) {
  Place place;
  const AnchoredScans anchored = anchored_scans(whole.scans);
  const bool cut = anchored.starts_piece || anchored.ends_piece;
  const Submap own = cut ? anchored_submap(whole) : Submap();
  const Submap& submap = cut ? own : whole;
  place.piece = (before ? before->piece + before->ends_piece : 0) + anchored.starts_piece;
  place.ends_piece = anchored.ends_piece;
  // After a loss the sensor never was at the keypose: the first anchored scan begins the path.
  place.path.emplace_back(anchored.starts_piece ? submap.scans.front().submap_from_sensor.translation
                                                : Eigen::Vector3d::Zero());
  for (const ScanPose& s : submap.scans) {
    if ((s.submap_from_sensor.translation - place.path.back()).norm() > kPathSpacing) {
      place.path.push_back(s.submap_from_sensor.translation);
    }
  }
  if (!submap.scans.empty()) place.path.push_back(submap.scans.back().submap_from_sensor.translation);
  place.path_begin_m = before ? before->path_end_m : 0.0;
  // The length of the thinned path: swaying of a hand-held sensor does not count as distance travelled.
  place.path_end_m = place.path_begin_m;
  for (std::size_t i = 1; i < place.path.size(); ++i) {
    place.path_end_m += (place.path[i] - place.path[i - 1]).norm();
  }
  place.doubtful_m = doubtful_way(submap);
  place.seen_radius_m = seen_radius(submap, place.path);
  place.ground = align_ground(submap.points, place.path);
  const DensityImage image = make_density_image(submap.points, place.ground.ground_from_submap,
                                                config.cell_size_m, config.density_cut);
  Features features = extract_features(image, config);
  place.keypoints = features.keypoints;
  return {std::move(place), std::move(features)};
}

std::vector<std::uint8_t> encode_place(const Place& place, const Features& features) {
  BlobWriter out;
  out.put_pose(place.ground.ground_from_submap);
  out.put(static_cast<std::uint8_t>(place.ground.found));
  out.put(place.ground.inlier_share);
  out.put(place.path_begin_m);
  out.put(place.path_end_m);
  out.put(place.doubtful_m);
  out.put(place.piece);
  out.put(static_cast<std::uint8_t>(place.ends_piece));
  out.put(place.seen_radius_m);
  out.put(static_cast<std::uint32_t>(place.path.size()));
  for (const auto& p : place.path) {
    for (int k = 0; k < 3; ++k) out.put(p[k]);
  }
  out.put(static_cast<std::uint32_t>(features.descriptors.size()));
  for (std::size_t i = 0; i < features.descriptors.size(); ++i) {
    out.put(features.keypoints[i].x());
    out.put(features.keypoints[i].y());
    for (const std::uint64_t word : features.descriptors[i]) out.put(word);
  }
  return out.finish();
}

std::pair<Place, Features> decode_place(const std::vector<std::uint8_t>& bytes, const std::string& where) {
  BlobReader in(bytes, where);
  Place place;
  Features features;
  place.ground.ground_from_submap = in.get_pose();
  place.ground.found = in.get<std::uint8_t>() != 0;
  place.ground.inlier_share = in.get<double>();
  place.path_begin_m = in.get<double>();
  place.path_end_m = in.get<double>();
  place.doubtful_m = in.get<double>();
  place.piece = in.get<std::int32_t>();
  place.ends_piece = in.get<std::uint8_t>() != 0;
  place.seen_radius_m = in.get<double>();
  const auto n_path = std::min<std::size_t>(in.get<std::uint32_t>(), in.left() / 24);
  for (std::size_t i = 0; i < n_path; ++i) {
    Eigen::Vector3d p;
    for (int k = 0; k < 3; ++k) p[k] = in.get<double>();
    place.path.push_back(p);
  }
  const auto n = std::min<std::size_t>(in.get<std::uint32_t>(), in.left() / 40);
  for (std::size_t i = 0; i < n; ++i) {
    const float x = in.get<float>(), y = in.get<float>();
    features.keypoints.emplace_back(x, y);
    Descriptor d;
    for (std::uint64_t& word : d) word = in.get<std::uint64_t>();
    features.descriptors.push_back(d);
  }
  place.keypoints = features.keypoints;
  return {std::move(place), std::move(features)};
}

void PlaceIndex::add_features(const Features& features) {
  const auto id = static_cast<std::int32_t>(places_.size() - 1);
  for (std::size_t i = 0; i < features.descriptors.size(); ++i) {
    tree_.insert({features.descriptors[i], id, static_cast<std::int32_t>(i)});
  }
}

double PlaceIndex::revisit_distance(std::int64_t from_id, std::int64_t to_id) const {
  if (config_.candidates == "paper") return to_id - from_id > config_.skip_newest ? kNoLimit : 0.0;
  const Place& from = places_[static_cast<std::size_t>(from_id)];
  const Place& to = places_[static_cast<std::size_t>(to_id)];
  // The distance of another piece is unknown: any similar place may be right.
  if (from.piece != to.piece) return kReach;
  const double gap = to.path_begin_m - from.path_end_m;
  const double seen = std::max(from.seen_radius_m, to.seen_radius_m);
  if (gap < std::clamp(2.0 * seen, kMinGap, kMaxGap)) return 0.0;
  return std::min(kReach, kComeBack * gap);
}

std::vector<Candidate> PlaceIndex::alike(const Features& features) const {
  const auto to_id = static_cast<std::int64_t>(places_.size()) - 1;
  const Place& to = places_.back();
  std::vector<std::vector<PointPair>> pairs(places_.size() - 1);
  std::vector<double> reach(places_.size() - 1);
  for (std::size_t i = 0; i < reach.size(); ++i)
    reach[i] = revisit_distance(static_cast<std::int64_t>(i), to_id);
  std::vector<TreeMatch> matches;
  for (std::size_t f = 0; f < features.descriptors.size(); ++f) {
    tree_.search(features.descriptors[f], config_.match_bits, matches);
    std::int32_t last = -1;
    for (const TreeMatch& m : matches) {
      if (m.submap == last) continue;  // sorted: the first of a submap is its nearest
      last = m.submap;
      const auto s = static_cast<std::size_t>(m.submap);
      if (reach[s] <= 0.0) continue;
      const auto& keypoint = places_[s].keypoints[static_cast<std::size_t>(m.feature)];
      pairs[s].push_back({keypoint.cast<double>(), features.keypoints[f].cast<double>()});
    }
  }
  std::vector<std::size_t> order;
  for (std::size_t s = 0; s < pairs.size(); ++s) {
    if (pairs[s].size() >= static_cast<std::size_t>(config_.ransac_inliers)) order.push_back(s);
  }
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return pairs[a].size() > pairs[b].size(); });
  if (order.size() > kMaxAligned) order.resize(kMaxAligned);
  std::vector<Candidate> candidates;
  for (const std::size_t s : order) {
    const Alignment2d a =
        align_2d(pairs[s], config_.ransac_cells * config_.cell_size_m, config_.ransac_inliers);
    if (a.inliers == 0) continue;
    candidates.push_back({static_cast<std::int64_t>(s), lifted(places_[s], to, a), a.inliers, reach[s]});
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.inliers > b.inliers; });
  return candidates;
}

std::vector<Candidate> PlaceIndex::near(std::int64_t to_id, const std::vector<Pose>& map_from_submap,
                                        const std::vector<double>& distances) const {
  const auto t = static_cast<std::size_t>(to_id);
  const Place& to = places_[t];
  const double to_length = to.path_end_m - to.path_begin_m;
  std::vector<std::pair<double, Candidate>> found;
  for (std::size_t i = 0; i < t; ++i) {
    if (distances[i] > kKnownWithin) continue;
    const double reach = std::min(revisit_distance(static_cast<std::int64_t>(i), to_id), kReach);
    if (reach <= 0.0) continue;
    const Pose guess = map_from_submap[i].inverse() * map_from_submap[t];
    const double from_length = places_[i].path_end_m - places_[i].path_begin_m;
    if (guess.translation.norm() > reach + from_length + to_length) continue;
    const double distance = path_distance(places_[i].path, to.path, guess);
    if (distance <= reach) found.push_back({distance, {static_cast<std::int64_t>(i), guess, 0, reach}});
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Candidate> candidates;
  for (const auto& f : found) candidates.push_back(f.second);
  return candidates;
}

std::vector<double> graph_distances(const std::vector<Place>& places,
                                    const std::vector<ClosureRecord>& closures, std::int64_t start) {
  const std::size_t n = places.size();
  std::vector<std::vector<std::size_t>> neighbours(n);
  for (const ClosureRecord& c : closures) {
    if (!c.accepted) continue;
    neighbours[static_cast<std::size_t>(c.from_submap)].push_back(static_cast<std::size_t>(c.to_submap));
    neighbours[static_cast<std::size_t>(c.to_submap)].push_back(static_cast<std::size_t>(c.from_submap));
  }
  std::vector<double> distance(n, std::numeric_limits<double>::infinity());
  using Item = std::pair<double, std::size_t>;
  std::priority_queue<Item, std::vector<Item>, std::greater<>> open;
  const auto reach = [&](std::size_t node, double d) {
    if (d >= distance[node]) return;
    distance[node] = d;
    open.emplace(d, node);
  };
  // The path from keypose k to keypose k + 1 leads through submap k.
  const auto way = [&](std::size_t k) {
    return places[k].path_end_m - places[k].path_begin_m + places[k].doubtful_m;
  };
  reach(static_cast<std::size_t>(start), 0.0);
  while (!open.empty()) {
    const auto [d, node] = open.top();
    open.pop();
    if (d > distance[node]) continue;
    if (node > 0 && places[node - 1].piece == places[node].piece) reach(node - 1, d + way(node - 1));
    if (node + 1 < n && places[node + 1].piece == places[node].piece) reach(node + 1, d + way(node));
    for (const std::size_t other : neighbours[node]) reach(other, d + kClosureLength);
  }
  return distance;
}

PoseBound drift_bound(const Pose& from_from_to, double distance_m, int inliers, const BackendConfig& config) {
  PoseBound bound;
  bound.from_from_to = from_from_to;
  if (!std::isfinite(distance_m)) return bound;
  const double doubt = inliers >= kManyInliers ? kDoubt : 1.0;
  bound.translation_m = kBoundFloor + doubt * config.max_drift * distance_m;
  bound.rotation_rad = std::min(M_PI, kRotationBoundFloor + doubt * kRotationBoundGrowth * distance_m);
  return bound;
}

}  // namespace hp2
