// Does an odometry err by as much as its covariances say?
#pragma once
#include <cstddef>
#include <vector>

#include "common/geometry/pose.hpp"

namespace hp2 {

/// Normalised error squared e^T C^-1 e of each motion from pose to pose, in order: 6 in the mean where the
/// covariances are honest, more where they promise too much. e are right increments (rho [m], phi [rad]) in
/// the current pose's frame, as the covariances' are.
/// @param reference, estimate poses of the same instants, one length
/// @param covariances of the motion to each pose from the one before; the first is not looked at
/// @return one a pair, for n poses n - 1; not a number where a covariance is not positive definite
std::vector<double> normalised_errors_squared(const std::vector<Pose>& reference,
                                              const std::vector<Pose>& estimate,
                                              const std::vector<Matrix6d>& covariances);

}  // namespace hp2
