// Synthetic drives: `synthetic:SCENE[:SEED]`.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "player/scan_source.hpp"

namespace hp2 {

/// Names of the scenes and what is in them, for help texts.
std::vector<std::pair<std::string, std::string>> synthetic_scenes();

/// Opens `synthetic:SCENE[:SEED]`; the seed (1 if not given) makes another world and other noise.
/// The scans are made when they are read, each a function of scene, seed and number alone.
/// @throws Error for an unknown scene or a seed that is no number, or if no scan is left
std::unique_ptr<ScanSource> open_synthetic(const std::string& spec, const SourceOptions& options);

}  // namespace hp2
