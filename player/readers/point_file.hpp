// One scan file's bytes into points: .bin, .pcd, .ply, .las, .npy, text. Nothing here knows of clocks or
// folders.
#pragma once
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "common/scan.hpp"
#include "player/readers/column.hpp"

namespace hp2 {

/// Points of one file. `scan` has x, y, z and maybe intensity; its clock is not set.
struct PointFile {
  Scan scan;
  std::vector<double> raw_time;     ///< A point's time as the file has it, in whatever unit; empty: absent.
  std::vector<std::string> fields;  ///< Names of the fields, where the file has names.
  bool integer = false;             ///< Coordinates are whole numbers, so their unit is not the metre.
};

/// Fields of one point in a table of points; first may be null for intensity and time.
struct PointColumns {
  Column x, y, z, intensity, time;
};

/// Reads n points of a table. See read_column for what the caller vouches for.
void read_points(const PointColumns& columns, std::size_t n, PointFile& out);

/// Moves the points of `file` into `scan`, whose clock stays as it is; `file` has its old points' memory
/// then.
void move_points(PointFile& file, Scan& scan);

/// KITTI's layout: float32 x y z intensity.
/// @throws Error if the size is not a multiple of 16 bytes
void parse_bin(std::string_view bytes, const std::string& path, PointFile& out);

/// PCD 0.7: ascii, binary, binary_compressed; fields x y z and maybe intensity and a time.
/// @throws Error if the header is not understood or promises more than the file has
void parse_pcd(std::string_view bytes, const std::string& path, PointFile& out);

/// PLY 1.0: ascii, binary of both byte orders; element vertex with scalar properties x y z and maybe
/// intensity and a time.
/// @throws Error if the header is not understood or promises more than the file has
void parse_ply(std::string_view bytes, const std::string& path, PointFile& out);

/// Text, a point per line: x y z [intensity] [time], or columns that the first line names.
/// @throws Error if a line has not the numbers that the first one has
void parse_text_points(std::string_view text, const std::string& path, PointFile& out);

/// NumPy array: N rows x y z [intensity] [time], or a structured one with these fields.
/// @throws Error if the header is not understood or promises more than the file has
void parse_npy(std::string_view bytes, const std::string& path, PointFile& out);

/// LAS 1.0 to 1.4 without compression. Coordinates of a map (offsets beyond 10 km) are left relative to the
/// offset.
/// @throws Error if the header is not understood or promises more than the file has
void parse_las(std::string_view bytes, const std::string& path, PointFile& out);

struct BinLayout;

/// Reads a file of one of these kinds by its extension, also with .gz behind it.
/// @param layout of the records of a .bin; null: KITTI's
/// @throws Error as above, and for another extension
void read_point_file(const std::string& path, PointFile& out, const BinLayout* layout = nullptr);

/// Extensions of the kinds that are read, without .gz: ".bin", ".pcd", ...
const std::vector<std::string>& point_file_extensions();

/// Rows of numbers as text, `width` a row, row-major into a table of doubles: the ascii kinds of PCD and PLY.
/// @throws Error if the text ends before n rows
std::vector<double> parse_ascii_table(std::string_view text, std::size_t n, std::size_t width,
                                      const std::string& path);

}  // namespace hp2
