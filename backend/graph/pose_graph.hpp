// The pose graph: keyposes as nodes, odometry and closures as edges, solved with Ceres on SE(3).
#pragma once
#include <cstddef>
#include <vector>

#include "common/geometry/pose.hpp"
#include "common/session.hpp"

namespace hp2 {

/// Error log(z^-1 a^-1 b) of an edge and its derivatives by right increments of the nodes, a Exp(x) and b
/// Exp(y).
/// @param by_a,by_b filled unless null
Vector6d edge_error(const Pose& a, const Pose& b, const Pose& z, Matrix6d* by_a, Matrix6d* by_b);

/// How far an edge is from the nodes, in metres and radians.
struct EdgeGap {
  double translation_m = 0.0, rotation_rad = 0.0;
};
EdgeGap edge_gap(const std::vector<Pose>& nodes, const GraphEdge& edge);

/// Outcome of optimise().
struct PoseGraphSummary {
  double initial_cost = 0.0, final_cost = 0.0;
  int iterations = 0;
  bool converged = false;
};

/// Moves all nodes but the first to the optimum, starting from where they are. Closures have a Cauchy loss.
/// @param closure_scale scale of that loss, in standard deviations; 0: no robust loss
PoseGraphSummary optimise(std::vector<Pose>& nodes, const std::vector<GraphEdge>& odometry,
                          const std::vector<GraphEdge>& closures, double closure_scale = 3.0);

/// Optimises with the closures that are consistent with each other. Those that stay further than `max_gap`
/// from the optimised graph are left out, worst first, and used again if the graph comes to agree with them.
/// @param odometry their information is lowered where the closures show that it is too large
/// @return one per closure: true if it was used
std::vector<bool> optimise_consistent(std::vector<Pose>& nodes, const std::vector<GraphEdge>& odometry,
                                      const std::vector<GraphEdge>& closures,
                                      const EdgeGap& max_gap = {1.0, 0.1});

}  // namespace hp2
