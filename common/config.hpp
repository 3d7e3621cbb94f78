// One YAML file configures every process: sections of named values, each with a default, a range and its
// documentation beside the struct that holds it. An unknown key is an error that names the nearest known
// one.
#pragma once
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace YAML {
class Node;
}

namespace hp2 {

/// A named group of settings bound to the members of a struct that outlives it.
class ConfigSection {
 public:
  explicit ConfigSection(std::string name) : name_(std::move(name)) {}

  /// Bind a key. `doc` says what it is, with its unit. A value outside [min, max] (or not among `choices`) is
  /// an error.
  void add(const std::string& key, double& value, const std::string& doc,
           double min = -std::numeric_limits<double>::infinity(),
           double max = std::numeric_limits<double>::infinity());
  void add(const std::string& key, int& value, const std::string& doc,
           int min = std::numeric_limits<int>::min(), int max = std::numeric_limits<int>::max());
  void add(const std::string& key, bool& value, const std::string& doc);
  void add(const std::string& key, std::string& value, const std::string& doc,
           const std::vector<std::string>& choices = {});
  /// A list of numbers, each of them in [min, max].
  void add(const std::string& key, std::vector<double>& values, const std::string& doc, double min,
           double max);

  const std::string& name() const { return name_; }

 private:
  friend class Config;
  struct Field {
    std::string key, doc, range;
    std::function<void(const YAML::Node&, const std::string& where)> read;
    std::function<std::string()> print;
  };
  std::string name_;
  std::vector<Field> fields_;
};

/// All sections that a program understands.
class Config {
 public:
  void add(ConfigSection section) { sections_.push_back(std::move(section)); }
  /// Declares sections of other programs of this project: their keys are left alone.
  void ignore(const std::vector<std::string>& section_names);
  /// Reads `path` into the bound values. Values that the file does not name keep their defaults.
  /// @throws Error naming file, line and key for a file that cannot be read, is not YAML, has an unknown key,
  /// or a
  ///         value of the wrong type or out of range.
  void load(const std::string& path);
  /// Sets one value from "section.key=value", as a line of a file would. @throws Error likewise
  void set(const std::string& assignment);
  /// The present values as a documented YAML file (comments carry documentation and ranges).
  std::string print() const;

 private:
  void apply(const YAML::Node& root, const std::function<std::string(const YAML::Node&)>& where);

  std::vector<ConfigSection> sections_;
  std::vector<std::string> ignored_;
};

/// The entry of `known` nearest to `word` by edit distance; empty if `known` is empty.
std::string nearest_word(const std::string& word, const std::vector<std::string>& known);

}  // namespace hp2
