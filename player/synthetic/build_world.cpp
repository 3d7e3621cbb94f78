#include "player/synthetic/build_world.hpp"

#include <algorithm>
#include <cmath>

#include "player/synthetic/random.hpp"

namespace hp2 {
namespace {

/// Adds objects to a world, each standing on the ground.
class Builder {
 public:
  explicit Builder(std::uint64_t seed) : random(seed * 0x9e3779b9ULL + 17) {}

  World world;
  Random random;

  /// An upright box from `low` to `high` above the ground at its centre.
  void box(double x, double y, double size_x, double size_y, double low, double high, double albedo,
           double yaw = 0) {
    const double ground = world.ground.height(x, y);
    world.add(Box{x, y, size_x / 2, size_y / 2, yaw, ground + low, ground + high, albedo});
  }
  /// A box that reaches into the ground, for what is so wide that the ground is not level under it.
  void block(double x, double y, double size_x, double size_y, double high, double albedo, double yaw = 0) {
    box(x, y, size_x, size_y, -2.0, high, albedo, yaw);
  }
  void post(double x, double y, double radius, double high, double albedo) {
    const double ground = world.ground.height(x, y);
    world.add(Cylinder{x, y, radius, ground - 1.0, ground + high, albedo});
  }
  void tree(double x, double y) {
    const double trunk = random.uniform(2.2, 3.2);
    const double crown = random.uniform(1.3, 2.2);
    post(x, y, random.uniform(0.12, 0.28), trunk + crown, 0.3);
    world.add(Crown{x, y, world.ground.height(x, y) + trunk + crown, crown, 0.4});
  }
  void car(double x, double y, double yaw) {
    const bool van = random.chance(0.2);
    const double length = random.uniform(3.8, 4.7);
    const double albedo = random.uniform(0.15, 0.9);
    yaw += random.uniform(-0.03, 0.03);
    box(x, y, length, 1.8, 0.25, van ? 1.9 : 0.85, albedo, yaw);
    if (!van) {
      const double back = random.uniform(-0.4, 0.0);
      box(x + back * std::cos(yaw), y + back * std::sin(yaw), length * 0.52, 1.55, 0.85, 1.42, 0.3, yaw);
    }
  }
  void sign(double x, double y, double yaw) {
    post(x, y, 0.04, 2.7, 0.6);
    box(x, y, 0.6, 0.06, 2.0, 2.6, 0.95, yaw);
  }
};

/// A straight row of plots along one side of a block: `s` runs along the street, `out` points to it.
struct Side {
  double x, y;  ///< Where s = 0 meets the plots' edge.
  double along_x, along_y;
  double out_x, out_y;
  double length;
};

void build_row(Builder& b, const Side& side) {
  Random& r = b.random;
  const double yaw = std::atan2(side.along_y, side.along_x);
  // Centre of something at `s` along the row whose middle is `inward` behind the plots' edge.
  const auto place = [&](double s, double inward) {
    return Eigen::Vector2d(side.x + side.along_x * s - side.out_x * inward,
                           side.y + side.along_y * s - side.out_y * inward);
  };
  double s = r.uniform(0.0, 1.5);
  while (s < side.length - 6.0) {
    const double width = std::min(r.uniform(7.0, 15.0), side.length - s);
    const double depth = r.uniform(7.5, 10.0);
    const double setback = r.chance(0.5) ? 0.0 : r.uniform(0.4, 2.2);
    const double height = r.uniform(5.0, 12.0);
    const double albedo = r.uniform(0.35, 0.85);
    Eigen::Vector2d p = place(s + width / 2, setback + depth / 2);
    b.block(p.x(), p.y(), width, depth, height, albedo, yaw);
    // Porches, bays, steps: what fixes the direction along the street.
    for (double at = s + r.uniform(0.8, 2.0); at < s + width - 1.5; at += r.uniform(2.6, 5.0)) {
      const double bay = r.uniform(0.9, 2.2);
      const double proud = r.uniform(0.25, 0.9);
      p = place(at + bay / 2, setback - proud / 2);
      if (at + bay < s + width) b.block(p.x(), p.y(), bay, proud, r.uniform(0.5, height), albedo * 0.8, yaw);
    }
    s += width;
    if (!r.chance(0.55)) continue;
    const double gap = std::min(r.uniform(2.0, 6.5), side.length - s);
    if (gap < 1.0) continue;
    if (r.chance(0.5)) {
      p = place(s + gap / 2, 0.2);
      b.block(p.x(), p.y(), gap, 0.3, r.uniform(0.9, 1.9), 0.5, yaw);
    }
    p = place(s + gap / 2, r.uniform(2.0, 5.0));
    if (r.chance(0.7)) b.tree(p.x(), p.y());
    s += gap;
  }
}

void build_block(Builder& b, double x0, double y0, double x1, double y1, bool park, bool church) {
  Random& r = b.random;
  const double cx = (x0 + x1) / 2;
  const double cy = (y0 + y1) / 2;
  if (park || church) {
    const double hedge = r.uniform(0.8, 1.2);
    b.block(cx - 3, y0 + 0.5, x1 - x0 - 9, 0.8, hedge, 0.35);
    b.block(cx + 3, y1 - 0.5, x1 - x0 - 9, 0.8, hedge, 0.35);
    b.block(x0 + 0.5, cy + 2, 0.8, y1 - y0 - 8, hedge, 0.35);
    b.block(x1 - 0.5, cy - 2, 0.8, y1 - y0 - 8, hedge, 0.35);
    if (church) {
      b.block(cx, cy, 20, 10, 11, 0.6);
      b.block(cx - 12, cy, 6, 6, 26, 0.6);
      for (double at = -8; at <= 8; at += 4) {
        b.block(cx + at, cy - 5.4, 0.8, 0.8, 8, 0.6);
        b.block(cx + at, cy + 5.4, 0.8, 0.8, 8, 0.6);
      }
    } else {
      b.post(cx, cy, 2.6, 0.9, 0.7);
      b.post(cx, cy, 0.6, 2.4, 0.7);
    }
    for (int i = 0; i < 22; ++i) {
      const double x = r.uniform(x0 + 2, x1 - 2);
      const double y = r.uniform(y0 + 2, y1 - 2);
      if (std::hypot(x - cx, y - cy) > (church ? 17 : 5)) b.tree(x, y);
    }
    return;
  }
  constexpr double kDepth = 10.5;  // the rows on the short sides keep clear of those on the long ones
  build_row(b, {x0, y0, 1, 0, 0, -1, x1 - x0});
  build_row(b, {x1, y1, -1, 0, 0, 1, x1 - x0});
  build_row(b, {x1, y0 + kDepth, 0, 1, 1, 0, y1 - y0 - 2 * kDepth});
  build_row(b, {x0, y1 - kDepth, 0, -1, -1, 0, y1 - y0 - 2 * kDepth});
}

/// What stands along one street, which runs from `from` to `to` along x (or y, if `turned`) at `across`.
void furnish_street(Builder& b, double across, double from, double to, const std::vector<double>& crossings,
                    bool turned) {
  Random& r = b.random;
  const auto near_crossing = [&](double s) {
    return std::any_of(crossings.begin(), crossings.end(), [&](double c) { return std::abs(s - c) < 10.5; });
  };
  for (const double side : {-1.0, 1.0}) {
    const auto at = [&](double s, double off) {
      return turned ? Eigen::Vector2d(across + side * off, s) : Eigen::Vector2d(s, across + side * off);
    };
    const double yaw = (turned ? M_PI / 2 : 0.0) + (side > 0 ? M_PI : 0.0);
    for (double s = from + r.uniform(2, 6); s < to; s += r.uniform(5.6, 8.5)) {
      if (near_crossing(s) || r.chance(0.5)) continue;
      const Eigen::Vector2d p = at(s, 4.3);
      b.car(p.x(), p.y(), yaw);
    }
    for (double s = from + r.uniform(3, 20); s < to; s += r.uniform(20, 27)) {
      const Eigen::Vector2d p = at(s, 5.7);
      if (!near_crossing(s)) b.post(p.x(), p.y(), 0.09, 6.0, 0.5);
    }
    for (double s = from + r.uniform(3, 20); s < to; s += r.uniform(9, 22)) {
      if (near_crossing(s)) continue;
      const Eigen::Vector2d p = at(s, 6.0);
      if (r.chance(0.45))
        b.tree(p.x(), p.y());
      else if (r.chance(0.3))
        b.sign(p.x(), p.y(), yaw + M_PI / 2);
      else if (r.chance(0.4))
        b.block(p.x(), p.y(), 1.1, 0.7, 1.2, 0.5, yaw);
    }
  }
}

}  // namespace

World build_town(std::uint64_t seed, const std::vector<double>& streets_x,
                 const std::vector<double>& streets_y) {
  Builder b(seed);
  b.world.ground.amplitude_m = 0.5;
  for (double& phase : b.world.ground.phase) phase = b.random.uniform();
  bool church = true;  // one is enough
  for (std::size_t i = 0; i + 1 < streets_x.size(); ++i) {
    for (std::size_t j = 0; j + 1 < streets_y.size(); ++j) {
      const bool park = b.random.chance(0.14);
      const bool has_church = !park && church && b.random.chance(0.15);
      if (has_church) church = false;
      build_block(b, streets_x[i] + kHalfStreet_m, streets_y[j] + kHalfStreet_m,
                  streets_x[i + 1] - kHalfStreet_m, streets_y[j + 1] - kHalfStreet_m, park, has_church);
    }
  }
  for (const double y : streets_y)
    furnish_street(b, y, streets_x.front(), streets_x.back(), streets_x, false);
  for (const double x : streets_x) furnish_street(b, x, streets_y.front(), streets_y.back(), streets_y, true);
  b.world.build();
  return std::move(b.world);
}

World build_corridor(std::uint64_t seed, double size_x, double size_y) {
  constexpr double kHalfWidth = 1.1;
  constexpr double kHigh = 2.6;
  Builder b(seed);
  Random& r = b.random;
  b.world.ceiling_m = kHigh;
  // One wall from s = 0 to `length`; `inward` points from the wall into the corridor.
  const auto wall = [&](double x, double y, double ax, double ay, double inward_x, double inward_y,
                        double length) {
    const double yaw = std::atan2(ay, ax);
    const auto slab = [&](double s, double width, double back, double thick, double low, double high,
                          double albedo) {
      const double off = back + thick / 2;
      b.box(x + ax * (s + width / 2) - inward_x * off, y + ay * (s + width / 2) - inward_y * off, width,
            thick, low, high, albedo, yaw);
    };
    slab(-0.5, length + 1.0, 0.3, 0.2, -0.5, kHigh + 0.5, 0.4);  // behind the doors, and tight at the corners
    double s = 0.0;
    while (s < length) {
      const double plain = std::min(r.uniform(1.2, 4.5), length - s);
      slab(s, plain, 0.0, 0.3, 0.0, kHigh, 0.8);
      if (r.chance(0.35) && plain > 1.5)  // a pillar, a cupboard, a radiator: it stands proud of the wall
        slab(s + r.uniform(0.2, plain - 0.9), r.uniform(0.3, 0.7), -r.uniform(0.12, 0.35), 0.36, 0.0,
             r.uniform(0.7, kHigh), 0.6);
      s += plain;
      if (s >= length) break;
      const double door = std::min(0.95, length - s);  // set back, with a lintel
      slab(s, door, 0.16, 0.1, 0.0, 2.1, 0.4);
      slab(s, door, 0.0, 0.3, 2.1, kHigh, 0.8);
      s += door;
    }
  };
  for (const double side : {-1.0, 1.0}) {  // outer wall, then the core's
    const double hx = size_x / 2 + side * kHalfWidth;
    const double hy = size_y / 2 + side * kHalfWidth;
    wall(-hx, -hy, 1, 0, 0, side, 2 * hx);
    wall(hx, -hy, 0, 1, -side, 0, 2 * hy);
    wall(hx, hy, -1, 0, 0, -side, 2 * hx);
    wall(-hx, hy, 0, -1, side, 0, 2 * hy);
  }
  b.world.build();
  return std::move(b.world);
}

}  // namespace hp2
