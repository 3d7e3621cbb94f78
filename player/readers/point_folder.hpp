// Folders of scan files: which files are the scans, and how all of them are to be read.
#pragma once
#include <string>
#include <vector>

#include "player/readers/bin_layout.hpp"
#include "player/readers/point_file.hpp"

namespace hp2 {

/// Names of the scans in `folder`: the files of the most frequent kind, in the order of the times that they
/// are named by, else in natural order. Empty if there is none. Other kinds are left out with a warning.
std::vector<std::string> list_scan_files(const std::string& folder, std::vector<std::string>& warnings);

/// Whether a file is a scan by its name.
bool is_scan_file(const std::string& name);
/// Whether it is one in text.
bool is_text_scan(const std::string& name);

/// How the scans of one drive are read.
struct PointReading {
  const BinLayout* layout = nullptr;  ///< Of .bin files.

  /// @throws Error as read_point_file()
  void read(const std::string& path, PointFile& out) const;
};

/// Finds layout and unit from a drive's first scans.
/// @param bin_layout name of the layout, if the user says it; else ""
/// @throws Error if the records of .bin files are not recognised
PointReading find_reading(const std::vector<std::string>& paths, const std::string& bin_layout,
                          std::vector<std::string>& warnings);

}  // namespace hp2
