#include "player/readers/bags/recording.hpp"

#include <algorithm>
#include <set>

#include <fmt/format.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr std::string_view kRos1Magic = "#ROSBAG V";
constexpr std::string_view kMcapMagic("\x89MCAP0\r\n", 8);
constexpr std::string_view kSqliteMagic = "SQLite format 3";

/// "drive_0.db3.zstd" as "drive_0.db3".
std::string plain_name(const std::string& name) {
  for (const std::string_view ending : {".zstd", ".zst", ".lz4", ".bz2"})
    if (name.size() > ending.size() && name.substr(name.size() - ending.size()) == ending)
      return name.substr(0, name.size() - ending.size());
  return name;
}

/// "rosbag", "rosbag2" or "" by a file's name.
std::string kind_of_name(const std::string& name) {
  const std::string plain = plain_name(name);
  const std::size_t dot = plain.rfind('.');
  const std::string extension = dot == std::string::npos ? "" : plain.substr(dot);
  if (extension == ".bag") return "rosbag";
  return extension == ".db3" || extension == ".mcap" ? "rosbag2" : "";
}

/// Names of the bags in a folder. What lies there twice, plain and compressed, is taken once.
std::vector<std::string> list_parts(const std::string& folder) {
  std::vector<std::string> parts;
  for (const char* extension : {".db3", ".mcap", ".bag", ".zstd", ".zst", ".lz4", ".bz2"})
    for (const std::string& name : list_files(folder, extension))
      if (!kind_of_name(name).empty()) parts.push_back(name);
  std::set<std::string> plain(parts.begin(), parts.end());
  parts.erase(std::remove_if(parts.begin(), parts.end(),
                             [&](const std::string& name) {
                               const std::string without = plain_name(name);
                               return without != name && !plain.insert(without).second;
                             }),
              parts.end());
  std::sort(parts.begin(), parts.end(), natural_less);
  return parts;
}

/// The names under relative_file_paths of a metadata.yaml; none if it is not there or damaged.
std::vector<std::string> parts_in_metadata(const std::string& path) {
  std::vector<std::string> names;
  if (!is_file(path)) return names;
  const std::string text = read_text(path);
  bool inside = false;
  for (const std::string_view line : split_lines(text)) {
    const std::size_t begin = line.find_first_not_of(' ');
    if (begin == std::string_view::npos) continue;
    std::string_view rest = line.substr(begin);
    if (rest.substr(0, 20) == "relative_file_paths:") {
      inside = true;
    } else if (inside && rest.substr(0, 2) == "- ") {
      rest.remove_prefix(2);
      while (!rest.empty() && (rest.back() == ' ' || rest.back() == '"' || rest.back() == '\''))
        rest.remove_suffix(1);
      while (!rest.empty() && (rest.front() == '"' || rest.front() == '\'')) rest.remove_prefix(1);
      names.push_back(base_name(std::string(rest)));
    } else if (inside) {
      break;
    }
  }
  return names;
}

/// The parts of a recording's folder: those of its metadata.yaml, or all without that list.
std::vector<std::string> parts_of(const std::string& folder, std::vector<std::string>& warnings) {
  const std::vector<std::string> there = list_parts(folder);
  const std::vector<std::string> listed = parts_in_metadata(folder + "/metadata.yaml");
  const auto is_listed = [&](const std::string& name) {
    return std::any_of(listed.begin(), listed.end(),
                       [&](const std::string& l) { return plain_name(l) == plain_name(name); });
  };
  std::vector<std::string> parts;
  std::copy_if(there.begin(), there.end(), std::back_inserter(parts), is_listed);
  if (parts.empty()) return there;
  for (const std::string& name : listed)
    if (std::none_of(parts.begin(), parts.end(),
                     [&](const std::string& part) { return plain_name(part) == plain_name(name); }))
      warnings.push_back(folder + "/metadata.yaml lists the part " + name +
                         ", which is not there: it is left out");
  return parts;
}

std::unique_ptr<BagFile> open_bag_file(const PlainFile& file, const WantedTypes& wanted) {
  const std::string head = file.file->read(0, 16);
  if (head.compare(0, kRos1Magic.size(), kRos1Magic) == 0) return open_ros1_bag(file, wanted);
  if (head.compare(0, kMcapMagic.size(), kMcapMagic) == 0) return open_mcap(file, wanted);
  if (head.compare(0, kSqliteMagic.size(), kSqliteMagic) == 0) return open_db3(file, wanted);
  throw Error(
      head.empty() ? "the file is empty" : "the file is no bag (it begins with none of the known marks)",
      file.file->path(), "Give a ROS 1 bag, a .db3 or an .mcap file.");
}

void merge_topics(const std::vector<BagTopic>& from, std::uint32_t file, const WantedTypes& wanted,
                  std::vector<BagTopic>& topics) {
  for (const BagTopic& topic : from) {
    BagTopic& to = topics[topic_index(topics, topic.name, topic.type, topic.encoding, wanted)];
    if (topic.count == 0) continue;
    to.first_us = to.count == 0 ? topic.first_us : std::min(to.first_us, topic.first_us);
    to.last_us = to.count == 0 ? topic.last_us : std::max(to.last_us, topic.last_us);
    to.count += topic.count;
    for (MessageRef ref : topic.refs) {
      ref.file = file;
      to.refs.push_back(ref);
    }
  }
}

}  // namespace

std::string recognise_bag(const std::string& path) {
  if (is_file(path)) {
    const std::string head = PartFile(path).read(0, 16);
    if (head.compare(0, kRos1Magic.size(), kRos1Magic) == 0) return "rosbag";
    if (head.compare(0, kMcapMagic.size(), kMcapMagic) == 0 ||
        head.compare(0, kSqliteMagic.size(), kSqliteMagic) == 0)
      return "rosbag2";
    // By its name: compressed as a whole, or damaged, which its reader reports.
    return kind_of_name(base_name(path));
  }
  const std::vector<std::string> parts = list_parts(path);
  return parts.empty() ? "" : kind_of_name(parts.front());
}

Recording::Recording(const std::string& path, const WantedTypes& wanted) : path_(path) {
  std::vector<std::string> paths = {path};
  if (is_folder(path)) {
    paths.clear();
    for (const std::string& name : parts_of(path, warnings_)) paths.push_back(path + "/" + name);
    if (paths.empty())
      throw Error("the folder holds no bag", path, "Give a folder with .db3, .mcap or .bag files.");
  }
  for (const std::string& part : paths) {
    try {
      const PlainFile plain = open_plain(part);
      auto file = open_bag_file(plain, wanted);
      if (!plain.warning.empty()) warnings_.push_back(plain.warning);
      warnings_.insert(warnings_.end(), file->warnings().begin(), file->warnings().end());
      merge_topics(file->topics(), static_cast<std::uint32_t>(files_.size()), wanted, topics_);
      files_.push_back(std::move(file));
    } catch (const Error& error) {
      if (paths.size() == 1) throw;
      warnings_.push_back("a part of the recording is left out: " + std::string(error.what()));
    }
  }
  if (files_.empty()) throw Error("no part of the recording can be read", path, warnings_.front());
}

std::string_view Recording::read(const MessageRef& ref, std::size_t most, MessageBytes& memory) const {
  const BagFile& file = *files_.at(ref.file);
  std::string_view bytes = file.read(ref, most, memory);
  const Compression compression = compression_of_bytes(bytes);
  // A message may be compressed by itself. CDR begins with a zero, and ROS 1 bags know no such thing.
  if (compression != Compression::kZstd && compression != Compression::kLz4) return bytes;
  if (bytes.size() == most) bytes = file.read(ref, kMaxFileBytes, memory);
  Expanded expanded = expand(compression, bytes, most, std::move(memory.expanded));
  memory.expanded = std::move(expanded.bytes);
  if (!expanded.complete && memory.expanded.size() < most)
    throw Error("a compressed message is damaged", path_, "Copy the recording again.");
  return memory.expanded;
}

std::uint64_t Recording::message_size(const BagTopic& topic) const {
  if (topic.refs.empty()) return 0;
  try {
    MessageBytes memory;
    return read(topic.refs.front(), kMaxFileBytes, memory).size();
  } catch (const Error&) {
    return 0;  // damaged messages are reported where they are played
  }
}

std::string Recording::describe(const BagTopic& topic) const {
  std::string text = fmt::format("{} ({}, {} messages", topic.name, topic.type, topic.count);
  if (topic.count > 1 && topic.last_us - topic.first_us > static_cast<std::int64_t>(100 * topic.count))
    text += fmt::format(", {:.1f} Hz", 1e6 * static_cast<double>(topic.count - 1) /
                                           static_cast<double>(topic.last_us - topic.first_us));
  const auto bytes = static_cast<double>(message_size(topic));
  if (bytes > 0)
    text += bytes >= 1e5 ? fmt::format(", {:.1f} MB each", bytes * 1e-6)
                         : fmt::format(", {:.1f} kB each", bytes * 1e-3);
  return text + ")";
}

}  // namespace hp2
