// What stands in the synthetic worlds.
#pragma once
#include <cstdint>
#include <vector>

#include "player/synthetic/world.hpp"

namespace hp2 {

/// Half the width of a street between the plots on its two sides [m].
constexpr double kHalfStreet_m = 7.0;

/// A small town on a grid of streets: houses with porches and bays, garden walls, trees, lamps, signs, parked
/// cars, parks and a church. `streets_x` are the x of the streets along y, `streets_y` the y of those along
/// x, rising; the blocks between them are built. The same seed gives the same town.
World build_town(std::uint64_t seed, const std::vector<double>& streets_x,
                 const std::vector<double>& streets_y);

/// A corridor around a rectangular core, size_x by size_y between the middles of its sides, centred at the
/// origin: walls with doors, pillars, cupboards, a ceiling.
World build_corridor(std::uint64_t seed, double size_x, double size_y);

}  // namespace hp2
