// .bin scans: files of records without a header. Which numbers a record has is checked for plausibility
// before it is believed.
#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "player/readers/point_file.hpp"

namespace hp2 {

/// A record of a .bin file: numbers of one type, x y z first.
struct BinLayout {
  const char* name;  ///< As --bin-layout has it: x y z, i(ntensity), r(ing), t(ime); or a data set's name.
  const char* what;  ///< For people.
  ScalarType type;
  std::size_t stride;  ///< Bytes a record.
  int intensity;       ///< Number of its column; -1: none.
  int ring;            ///< The same.
  int time;            ///< The same.
  bool nclt = false;   ///< uint16 in units of 5 mm from -100 m, x forward, y right, z down; then two bytes.
};

/// KITTI's: float32 x y z intensity.
const BinLayout& kitti_bin_layout();

/// @throws Error that names the known ones
const BinLayout& bin_layout_of_name(const std::string& name);

/// A layout, and a remark for the user on how it was found; "" if it is the usual one.
struct BinLayoutChoice {
  const BinLayout* layout = nullptr;
  std::string note;
};

/// The layout that a drive's first scans have: KITTI's if it is plausible, else the one that is clearly
/// right.
/// @param files the contents of some scans; empty ones are ignored
/// @throws Error with what was found, if no layout fits
BinLayoutChoice choose_bin_layout(const std::vector<std::string>& files, const std::string& where);

/// Reads the records of one file. @throws Error if the size is no multiple of the record's
void parse_bin(std::string_view bytes, const std::string& path, const BinLayout& layout, PointFile& out);

}  // namespace hp2
