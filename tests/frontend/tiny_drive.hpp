// The player's smallest made-up drive, read once, and the front-end run over it.
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "frontend/frontend.hpp"
#include "player/scan_source.hpp"
#include "tests/frontend/made_up_clouds.hpp"

namespace hp2::test {

struct TinyDrive {
  std::vector<Scan> scans;
  std::vector<Pose> truth;  ///< Sensor at each sweep's end, relative to the first of them.
};

inline const TinyDrive& tiny_drive() {
  static const TinyDrive drive = [] {
    const auto source = open_source("synthetic:tiny");
    TinyDrive d;
    for (std::size_t i = 0; i < source->size(); ++i) {
      d.scans.push_back(source->read(i));
      d.truth.push_back(source->ground_truth().front().pose.inverse() * source->ground_truth()[i].pose);
    }
    return d;
  }();
  return drive;
}

/// Defaults with submaps short enough for several of them in the drive, which no search of the start keeps
/// open.
inline FrontendConfig short_submaps(const std::string& mode = FrontendConfig().mode) {
  FrontendConfig c;
  c.mode = mode;
  c.submap_length_m = 6.0;
  c.robust.start_search = false;
  return c;
}

inline std::vector<FrontendOutput> run(Frontend& frontend, const std::vector<Scan>& scans,
                                       std::size_t first = 0) {
  std::vector<FrontendOutput> out;
  for (std::size_t i = first; i < scans.size(); ++i) out.push_back(frontend.process(scans[i]));
  return out;
}

}  // namespace hp2::test
