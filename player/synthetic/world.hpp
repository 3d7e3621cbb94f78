// A world of simple solids on gently rolling ground, and the ray that finds the first of them.
#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace hp2 {

/// Height of the ground: three long waves.
struct Ground {
  double amplitude_m = 0.0;       ///< No point is further from z = 0; 0: flat.
  std::array<double, 3> phase{};  ///< Of each wave, in turns.

  /// Height [m] and slopes dz/dx, dz/dy at (x, y).
  Eigen::Vector3d at(double x, double y) const;
  double height(double x, double y) const { return at(x, y)[0]; }
};

/// An upright box, turned about the vertical.
struct Box {
  double x = 0, y = 0;            ///< Centre [m].
  double half_x = 0, half_y = 0;  ///< Half its sides, in its own axes [m].
  double yaw = 0;                 ///< [rad]
  double z_low = 0, z_high = 0;   ///< [m]
  double albedo = 0.5;            ///< 0..1
};

/// An upright cylinder.
struct Cylinder {
  double x = 0, y = 0, radius = 0, z_low = 0, z_high = 0, albedo = 0.5;
};

/// A ball of leaves: rays end somewhere inside it.
struct Crown {
  double x = 0, y = 0, z = 0, radius = 0, albedo = 0.5;
};

/// What a ray met.
struct Hit {
  double range = -1.0;         ///< [m]; below 0: nothing.
  double cos_incidence = 1.0;  ///< 1: head on.
  double albedo = 0.0;
  bool leaves = false;  ///< The surface is not sharp.
};

/// Fill it, build() it, then cast rays: cast() is const and thread-safe.
class World {
 public:
  Ground ground;
  double ceiling_m = 1e9;  ///< Height of a flat ceiling.

  void add(const Box& box) { boxes_.push_back(box); }
  void add(const Cylinder& cylinder) { cylinders_.push_back(cylinder); }
  void add(const Crown& crown) { crowns_.push_back(crown); }

  /// Sorts the solids into a grid of columns.
  void build();
  /// The first thing that the ray origin + range * direction meets at most `max_range` away.
  /// @param direction unit length
  Hit cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction, double max_range) const;

 private:
  struct TurnedBox {  ///< A Box with its sine and cosine at hand.
    Box box;
    double c, s;
  };

  struct Bounds {  ///< What a solid covers.
    std::uint32_t id;
    double x0, y0, x1, y1, top;
  };

  std::vector<Bounds> bounds();
  void cast_ground(const Eigen::Vector3d& o, const Eigen::Vector3d& d, double max_range, Hit& hit) const;
  void cast_box(const TurnedBox& b, const Eigen::Vector3d& o, const Eigen::Vector3d& d, Hit& hit) const;
  void cast_cylinder(const Cylinder& c, const Eigen::Vector3d& o, const Eigen::Vector3d& d, Hit& hit) const;
  void cast_crown(const Crown& c, const Eigen::Vector3d& o, const Eigen::Vector3d& d, Hit& hit) const;

  std::vector<Box> boxes_;
  std::vector<Cylinder> cylinders_;
  std::vector<Crown> crowns_;
  std::vector<TurnedBox> turned_;
  double x0_ = 0, y0_ = 0;  ///< Corner of the grid [m].
  int nx_ = 0, ny_ = 0;
  std::vector<std::uint32_t> start_;    ///< First entry of each cell in entries_, one more at the end.
  std::vector<std::uint32_t> entries_;  ///< Index, with the kind in the top two bits.
  std::vector<double> top_;             ///< Highest point of what is in each cell [m].
};

}  // namespace hp2
