#include "player/readers/point_folder.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <set>

#include "common/error.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/layout.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kLookedAt = 5;  // scans

std::string lower(std::string s) {
  for (char& c : s) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return s;
}

/// A name's extension without .gz; "" if it is no scan's.
std::string kind_of(const std::string& name) {
  std::string s = lower(name);
  const std::string packed = ".gz";
  if (s.size() > packed.size() && s.compare(s.size() - packed.size(), packed.size(), packed) == 0)
    s.resize(s.size() - packed.size());
  for (const char* other : {"times.txt", "poses.txt", "poses_end.txt", "calib.txt", "readme.txt", "imu.csv"})
    if (s == other) return "";  // what lies beside scans
  for (const std::string& extension : point_file_extensions())
    if (s.size() > extension.size() &&
        s.compare(s.size() - extension.size(), extension.size(), extension) == 0)
      return extension;
  return "";
}

bool is_text(const std::string& kind) {
  return kind == ".xyz" || kind == ".csv" || kind == ".asc" || kind == ".txt";
}

}  // namespace

bool is_scan_file(const std::string& name) { return !kind_of(name).empty(); }
bool is_text_scan(const std::string& name) { return is_text(kind_of(name)); }

std::vector<std::string> list_scan_files(const std::string& folder, std::vector<std::string>& warnings) {
  std::vector<std::string> best;
  std::size_t others = 0;
  for (const std::string& extension : point_file_extensions()) {
    std::vector<std::string> names = list_files(folder, extension);
    for (const std::string& name : list_files(folder, ".gz"))
      if (kind_of(name) == extension) names.push_back(name);
    names.erase(
        std::remove_if(names.begin(), names.end(), [](const std::string& n) { return kind_of(n).empty(); }),
        names.end());
    // Text lies beside scans of other kinds as notes and tables.
    if (is_text(extension) && !best.empty()) continue;
    if (names.size() > best.size()) std::swap(names, best);
    others += names.size();
  }
  if (others > 0)
    warnings.push_back(folder + " holds scans of several kinds: the " + std::to_string(others) +
                       " files of the rarer kinds are left out");
  std::sort(best.begin(), best.end(), natural_less);
  if (std::all_of(best.begin(), best.end(), [](const std::string& n) { return stamp_of_name(n) >= 0; }))
    std::stable_sort(best.begin(), best.end(), [](const std::string& a, const std::string& b) {
      return stamp_of_name(a) < stamp_of_name(b);
    });
  return best;
}

void PointReading::read(const std::string& path, PointFile& out) const { read_point_file(path, out, layout); }

PointReading find_reading(const std::vector<std::string>& paths, const std::string& bin_layout,
                          std::vector<std::string>& warnings) {
  PointReading reading;
  const std::size_t n = std::min(paths.size(), kLookedAt);
  if (n == 0) return reading;
  if (!bin_layout.empty()) reading.layout = &bin_layout_of_name(bin_layout);
  if (kind_of(base_name(paths[0])) == ".bin" && bin_layout.empty()) {
    std::vector<std::string> contents;
    for (std::size_t i = 0; i < n; ++i) {
      try {
        std::string bytes = read_text(paths[i]);
        if (lower(paths[i]).rfind(".gz") == paths[i].size() - 3) bytes = expand_gzip(bytes, paths[i]);
        contents.push_back(std::move(bytes));
      } catch (const Error&) {
        // A damaged scan is reported when it is its turn to be read.
      }
    }
    const BinLayoutChoice choice = choose_bin_layout(contents, parent_folder(paths[0]));
    reading.layout = choice.layout;
    if (!choice.note.empty()) warnings.push_back(choice.note);
  }

  std::set<std::string> fields;
  bool timed = false;
  for (std::size_t i = 0; i < n; ++i) {
    try {
      PointFile file;
      read_point_file(paths[i], file, reading.layout);
      timed = timed || !file.raw_time.empty();
      fields.insert(file.fields.begin(), file.fields.end());
    } catch (const Error&) {
      // As above.
    }
  }
  std::string unknown;
  for (const std::string& field : fields)
    if (!timed && field != "x" && field != "y" && field != "z" && field != "_" && !is_intensity_name(field))
      unknown += (unknown.empty() ? "" : ", ") + field;
  if (!unknown.empty())
    warnings.push_back(
        parent_folder(paths[0]) +
        ": no field is a time of the points by its name; besides x, y, z there are: " + unknown);
  return reading;
}

}  // namespace hp2
