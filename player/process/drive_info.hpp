// hp2_player --info: what a drive is, what its scans hold, and what a run would stop at.
#pragma once
#include <string>

#include "player/scan_source.hpp"

namespace hp2 {

/// Lines of text on the drive. Reads up to 200 of its scans, spread evenly; those that cannot be read are
/// named.
std::string describe_drive(const ScanSource& source);

}  // namespace hp2
