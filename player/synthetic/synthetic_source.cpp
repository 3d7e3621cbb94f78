#include "player/synthetic/synthetic_source.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "common/config.hpp"
#include "common/error.hpp"
#include "player/readers/drive.hpp"
#include "player/synthetic/build_world.hpp"
#include "player/synthetic/random.hpp"
#include "player/synthetic/route.hpp"

namespace hp2 {
namespace {

constexpr double kSweep_s = 0.1;
constexpr double kEccentricAt = 1.0;  // rad; the direction of the eccentricity

/// A spinning LiDAR: beams fire together, columns one after the other, clockwise, from behind the vehicle.
struct Sensor {
  std::string name;
  int beams = 32;
  int columns = 900;
  double lowest_deg = -25.0;
  double highest_deg = 12.0;
  double max_range_m = 80.0;
  double noise_m = 0.015;
  // What its calibration does not know: points are written with nominal angles and ranges.
  double elevation_error_deg = 0.0;  ///< Of each beam, standard deviation.
  double range_error_m = 0.0;        ///< Of each beam, standard deviation.
  double eccentricity_deg = 0.0;     ///< Of the encoder: amplitude of the azimuth's error over a turn.
};

/// A beam as the sensor's calibration has it, and as it is.
struct Beam {
  double cos_elevation, sin_elevation;
  double true_cos_elevation, true_sin_elevation;
  double range_error_m;
};

std::vector<Beam> make_beams(const Sensor& sensor, std::uint64_t seed) {
  Random random(seed * 0x2545f4914f6cdd1dULL + 5);  // of its own: errors leave the noise as it is
  constexpr double kRadian = M_PI / 180;
  std::vector<Beam> beams;
  for (int k = 0; k < sensor.beams; ++k) {
    const double share = static_cast<double>(k) / (sensor.beams - 1);
    const double elevation = (sensor.lowest_deg + (sensor.highest_deg - sensor.lowest_deg) * share) * kRadian;
    const double truly = elevation + sensor.elevation_error_deg * kRadian * random.normal();
    beams.push_back({std::cos(elevation), std::sin(elevation), std::cos(truly), std::sin(truly),
                     sensor.range_error_m * random.normal()});
  }
  return beams;
}

struct Scene {
  std::string name, text;
  Sensor sensor;
  std::size_t max_scans;
  RouteOptions route;
  std::vector<Eigen::Vector2d> way_points;
  World (*build)(std::uint64_t seed);
};

// The town's streets. Its blocks are 41 x 34 m.
World large_town(std::uint64_t seed) {
  return build_town(seed, {-110, -55, 0, 55, 110, 165}, {-96, -48, 0, 48, 96, 144});
}
World small_town(std::uint64_t seed) { return build_town(seed, {-55, 0, 55, 110}, {-48, 0, 48, 96}); }
World corridor(std::uint64_t seed) { return build_corridor(seed, 26, 17); }

std::vector<Scene> make_scenes() {
  const Sensor full{"synthetic-32", 32, 900, -25, 12, 80, 0.015};
  const Sensor small{"synthetic-16", 16, 500, -20, 10, 60, 0.015};
  RouteOptions ring;
  ring.closed = true;
  ring.repeat_m = 70.0;
  ring.right_m = 1.2;
  ring.weave_m = 0.25;
  RouteOptions open = ring;
  open.closed = false;
  open.corner_m = 3.0;
  open.right_m = 0.0;
  RouteOptions indoors = ring;
  indoors.repeat_m = 12.0;
  indoors.corner_m = 0.8;
  indoors.right_m = 0.0;
  indoors.weave_m = 0.1;
  indoors.max_speed = 1.3;
  indoors.lateral_acceleration = 0.8;
  indoors.sensor_height_m = 1.2;
  indoors.sway_rad = 0.03;
  RouteOptions long_ring = ring;
  long_ring.repeat_m = 100.0;
  long_ring.max_speed = 10.0;
  Sensor uncalibrated = full;
  uncalibrated.noise_m = 0.02;
  uncalibrated.elevation_error_deg = 0.05;
  uncalibrated.range_error_m = 0.01;
  uncalibrated.eccentricity_deg = 0.15;
  RouteOptions hop = ring;
  hop.repeat_m = 0.0;

  // A ring begins in the middle of a street, not at a crossing.
  const std::vector<Eigen::Vector2d> around = {{25, 0},  {110, 0}, {110, 48}, {55, 48},
                                               {55, 96}, {0, 96},  {0, 0}};
  const std::vector<Eigen::Vector2d> eight = {{20, 0},   {55, 0},  {55, 48}, {55, 96}, {110, 96},
                                              {110, 48}, {55, 48}, {0, 48},  {0, 0}};
  const std::vector<Eigen::Vector2d> two_rings = {{25, -96}, {110, -96}, {110, 96}, {-110, 96}, {-110, -48},
                                                  {55, -48}, {55, 144},  {0, 144},  {0, -96}};
  const std::vector<Eigen::Vector2d> there_and_back = {{-80, -1.4}, {104, -1.4}, {108, -5.5}, {115, -2.5},
                                                       {115, 2.5},  {108, 5.5},  {104, 1.4},  {-80, 1.4}};
  const std::vector<Eigen::Vector2d> indoor = {{0, -8.5}, {13, -8.5}, {13, 8.5}, {-13, 8.5}, {-13, -8.5}};
  const std::vector<Eigen::Vector2d> block = {{25, 0}, {55, 0}, {55, 48}, {0, 48}, {0, 0}};
  return {
      {"loop", "around three blocks of a small town; the last 70 m repeat the start", full, 100000, ring,
       around, large_town},
      {"figure8", "a figure of eight through the town that crosses itself", full, 100000, ring, eight,
       large_town},
      {"district", "through a town with a sensor that is not calibrated: odometry drifts, loops repair it",
       uncalibrated, 100000, long_ring, two_rings, large_town},
      {"reverse", "along a street and back in the opposite direction", full, 100000, open, there_and_back,
       large_town},
      {"corridor", "around an indoor corridor, held by hand", full, 100000, indoors, indoor, corridor},
      {"block", "around one block with a small sensor; the last 70 m repeat the start", small, 100000, ring,
       block, small_town},
      {"tiny", "40 scans of 8,000 rays at the beginning of block", small, 40, hop, block, small_town},
  };
}

/// A world, a route through it, and the sensor.
class SyntheticDrive {
 public:
  SyntheticDrive(const Scene& scene, std::uint64_t seed)
      : sensor_(scene.sensor),
        seed_(seed),
        world_(scene.build(seed)),
        route_(scene.way_points, scene.route, world_.ground),
        size_(std::min(scene.max_scans, static_cast<std::size_t>(route_.duration() / kSweep_s))),
        beams_(make_beams(sensor_, seed)) {}

  std::size_t size() const { return size_; }

  /// Pose at the end of sweep `index`; that of sweep 0 is the identity.
  Pose pose_at_end(std::size_t index) const {
    return route_.pose_at(kSweep_s).inverse() * route_.pose_at(kSweep_s * static_cast<double>(index + 1));
  }

  /// Fires all rays of sweep `index`.
  void fire(std::size_t index, Scan& scan) const {
    Random random(seed_ ^ (0x5851f42d4c957f2dULL * (index + 1)));
    const auto rays = static_cast<std::size_t>(sensor_.columns) * beams_.size();
    for (auto* column : {&scan.x, &scan.y, &scan.z, &scan.intensity, &scan.time}) {
      column->clear();
      column->reserve(rays);
    }
    for (int c = 0; c < sensor_.columns; ++c) {
      const double s = static_cast<double>(c) / sensor_.columns;
      const Pose pose = route_.pose_at(kSweep_s * (static_cast<double>(index) + s));
      const Eigen::Matrix3d rotation = pose.rotation.toRotationMatrix();
      const double azimuth = M_PI * (1.0 - 2.0 * s);
      const double cos_azimuth = std::cos(azimuth);
      const double sin_azimuth = std::sin(azimuth);
      const double true_azimuth =
          azimuth + sensor_.eccentricity_deg * M_PI / 180 * std::sin(azimuth + kEccentricAt);
      const double true_cos = std::cos(true_azimuth);
      const double true_sin = std::sin(true_azimuth);
      for (const Beam& beam : beams_) {
        const Eigen::Vector3d ray(beam.cos_elevation * cos_azimuth, beam.cos_elevation * sin_azimuth,
                                  beam.sin_elevation);
        const Eigen::Vector3d true_ray(beam.true_cos_elevation * true_cos, beam.true_cos_elevation * true_sin,
                                       beam.true_sin_elevation);
        const Hit hit = world_.cast(pose.translation, rotation * true_ray, sensor_.max_range_m);
        // Always as many random numbers a ray, so that one ray's fate does not change the next one's noise.
        const double noise = random.normal();
        const double luck = random.uniform();
        if (hit.range < 0.0 || luck < chance_of_loss(hit)) continue;
        const double depth = hit.leaves ? 0.6 * luck : 0.0;
        const double range = hit.range + depth + beam.range_error_m + sensor_.noise_m * noise;
        scan.x.push_back(static_cast<float>(range * ray.x()));
        scan.y.push_back(static_cast<float>(range * ray.y()));
        scan.z.push_back(static_cast<float>(range * ray.z()));
        scan.intensity.push_back(static_cast<float>(hit.albedo * (0.3 + 0.7 * hit.cos_incidence)));
        scan.time.push_back(static_cast<float>(s));
      }
    }
  }

 private:
  /// Far, dark and grazing returns get lost more often.
  double chance_of_loss(const Hit& hit) const {
    const double far = hit.range / sensor_.max_range_m;
    return 0.01 + 0.5 * far * far * far * (1.2 - hit.albedo) * (1.5 - hit.cos_incidence);
  }

  Sensor sensor_;
  std::uint64_t seed_;
  World world_;
  Route route_;
  std::size_t size_;
  std::vector<Beam> beams_;
};

}  // namespace

std::vector<std::pair<std::string, std::string>> synthetic_scenes() {
  std::vector<std::pair<std::string, std::string>> result;
  for (const Scene& scene : make_scenes()) result.emplace_back(scene.name, scene.text);
  return result;
}

std::unique_ptr<ScanSource> open_synthetic(const std::string& spec, const SourceOptions& options) {
  const std::string rest = spec.substr(spec.find(':') + 1);
  const std::string name = rest.substr(0, rest.find(':'));
  std::uint64_t seed = 1;
  if (name.size() < rest.size()) {
    const std::string digits = rest.substr(name.size() + 1);
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), seed);
    if (error != std::errc() || end != digits.data() + digits.size())
      throw Error("the seed is not a whole number", spec,
                  "Write synthetic:SCENE:SEED, e.g. synthetic:loop:1.");
  }
  const std::vector<Scene> scenes = make_scenes();
  const auto scene =
      std::find_if(scenes.begin(), scenes.end(), [&](const Scene& s) { return s.name == name; });
  if (scene == scenes.end()) {
    std::vector<std::string> names;
    std::string list;
    for (const Scene& s : scenes) {
      names.push_back(s.name);
      list += (list.empty() ? "" : ", ") + s.name;
    }
    throw Error("there is no synthetic scene of this name", spec,
                "Did you mean '" + nearest_word(name, names) + "'? There are: " + list + ".");
  }
  const auto made = std::make_shared<const SyntheticDrive>(*scene, seed);
  Drive drive;
  drive.info.name = "synthetic:" + name + ":" + std::to_string(seed);
  drive.info.format = "synthetic";
  drive.info.sensor = scene->sensor.name;
  const auto sweep_us = static_cast<std::int64_t>(kSweep_s * 1e6);
  for (std::size_t i = 0; i < made->size(); ++i) {
    drive.scans.push_back(
        {"", static_cast<std::int64_t>(i) * sweep_us, sweep_us, static_cast<std::int64_t>(i)});
    drive.ground_truth.emplace_back(made->pose_at_end(i));
  }
  drive.decode = [made](const DriveScan& entry, Scan& scan) {
    made->fire(static_cast<std::size_t>(entry.key), scan);
  };
  return make_source(std::move(drive), options);
}

}  // namespace hp2
