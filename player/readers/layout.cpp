#include "player/readers/layout.hpp"

#include <charconv>

#include "common/error.hpp"
#include "player/readers/bags/recording.hpp"
#include "player/readers/file_io.hpp"
#include "player/readers/ground_truth.hpp"
#include "player/readers/point_folder.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {

std::optional<Pose> kitti_camera_from_lidar(const std::string& path) {
  if (!is_file(path)) return std::nullopt;
  const std::string text = read_text(path);
  for (const std::string_view line : split_lines(text)) {
    for (const std::string_view key : {"Tr:", "Tr_velo_to_cam:"}) {
      if (line.substr(0, key.size()) != key) continue;
      const std::vector<double> numbers = parse_numbers(line.substr(key.size()));
      return pose_from_numbers(numbers.data(), numbers.size());
    }
  }
  return std::nullopt;
}

std::int64_t stamp_of_name(const std::string& name) {
  std::string s = stem(name);
  for (const std::string extension : {".pcd", ".bin", ".ply"})  // NAME.pcd.bin, NAME.bin.gz
    if (s.size() > extension.size() &&
        s.compare(s.size() - extension.size(), extension.size(), extension) == 0)
      s.resize(s.size() - extension.size());
  const auto digits_before = [&](std::size_t end) {
    std::size_t begin = end;
    while (begin > 0 && s[begin - 1] >= '0' && s[begin - 1] <= '9') --begin;
    return begin;
  };
  const std::size_t last = digits_before(s.size());
  const std::string digits = s.substr(last);
  if (digits.empty() || digits.size() > 19) return -1;
  std::int64_t value = 0;
  if (std::from_chars(digits.data(), digits.data() + digits.size(), value).ec != std::errc()) return -1;
  // All of the name, or the part after its last underscore.
  if ((last == 0 || s[last - 1] == '_') && value > 0) {
    if (digits.size() == 19) return value / 1000;
    if (digits.size() == 16) return value;
  }
  // SECONDS.FRACTION or SECONDS_NANOSECONDS, maybe behind a word and an underscore.
  if (last < 2 || (s[last - 1] != '.' && s[last - 1] != '_') || digits.size() > 9) return -1;
  const std::size_t first = digits_before(last - 1);
  const std::string seconds_digits = s.substr(first, last - 1 - first);
  if (seconds_digits.size() != 10 || (first > 0 && s[first - 1] != '_' && s[first - 1] != '-')) return -1;
  std::int64_t seconds = 0;
  std::from_chars(seconds_digits.data(), seconds_digits.data() + seconds_digits.size(), seconds);
  if (s[last - 1] == '.')
    for (std::size_t i = digits.size(); i < 9; ++i) value *= 10;
  return seconds * 1'000'000 + value / 1000;
}

std::vector<std::int64_t> stamps_of_names(const std::string& folder, const std::vector<std::string>& names,
                                          std::vector<std::string>& warnings) {
  std::vector<std::int64_t> stamps;
  for (const std::string& name : names) {
    const std::int64_t stamp = stamp_of_name(name);
    if (stamp >= 0 && (stamps.empty() || stamp > stamps.back())) {
      stamps.push_back(stamp);
      continue;
    }
    warnings.push_back(folder + " has the file " + name +
                       ", whose name is no time: assuming 10 scans a second");
    stamps.clear();
    for (std::size_t i = 0; i < names.size(); ++i)
      stamps.push_back(static_cast<std::int64_t>(i) * kAssumedSweep_us);
    return stamps;
  }
  return stamps;
}

std::vector<std::string> list_bin_scans(const std::string& folder) {
  std::vector<std::string> names = list_files(folder, ".bin");
  if (names.empty())
    throw Error("the folder holds no scan", folder, "Scans there are .bin files named by their times.");
  return names;
}

std::string recognise_format(const std::string& path) {
  if (is_file(path)) {
    const std::string head = PartFile(path).read(0, 16);
    if (head.rfind("\xed\xa1\xda\x01", 0) == 0) return "lcm-log";
    for (const char* magic :
         {"\xd4\xc3\xb2\xa1", "\xa1\xb2\xc3\xd4", "\x4d\x3c\xb2\xa1", "\xa1\xb2\x3c\x4d", "\x0a\x0d\x0d\x0a"})
      if (head.rfind(magic, 0) == 0) return "pcap";
    for (const char* ending : {".pcap", ".pcapng"})
      if (path.size() > 7 && path.find(ending, path.size() - 7) != std::string::npos) return "pcap";
    if (is_scan_file(base_name(path))) return "generic";  // one scan
    return recognise_bag(path);
  }
  const std::string name = base_name(path);
  if (is_folder(path + "/velodyne_points/data") || (name == "velodyne_points" && is_folder(path + "/data")))
    return "kitti-raw";
  if (!helipr_sensor_folders(path).empty()) return "helipr";
  if (is_folder(path + "/Ouster") || (name == "Ouster" && is_file(path + "/../global_pose.csv")))
    return "mulran";
  if (is_folder(path + "/pcds") || (name == "pcds" && is_folder(path + "/../poses"))) return "apollo";
  if (is_folder(path + "/velodyne") && kitti_camera_from_lidar(path + "/calib.txt")) return "kitti";
  const std::string bag = recognise_bag(path);
  std::vector<std::string> warnings;
  for (const std::string& folder : {path + "/velodyne", path, path + "/lidar"}) {
    const std::vector<std::string> scans = list_scan_files(folder, warnings);
    // Text beside a bag is its trajectory or notes.
    if (!scans.empty() && (bag.empty() || !is_text_scan(scans.front()))) return "generic";
  }
  return bag;
}

}  // namespace hp2
