#include "common/config.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <numeric>
#include <set>
#include <sstream>

#include <yaml-cpp/yaml.h>

#include "common/error.hpp"
#include "common/text.hpp"

namespace hp2 {
namespace {

std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

// Letters alone, in lower case: voxelSize, voxel-size and VOXEL_SIZE are the same word.
std::string simplified(const std::string& word) {
  std::string out;
  for (const char c : word)
    if (std::isalnum(static_cast<unsigned char>(c)) != 0)
      out += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return out;
}

template <class T>
std::string to_text(const T& value) {
  std::ostringstream s;
  s.precision(15);
  s << value;
  return s.str();
}

template <class T>
T convert(const YAML::Node& node, const std::string& where, const std::string& type) {
  try {
    return node.as<T>();
  } catch (const YAML::Exception&) {
    throw Error("the value is not " + type, where,
                "Write " + type + " there, or leave the key out for its default.");
  }
}

template <class T>
void check_range(T value, T min, T max, const std::string& where) {
  if (!(value >= min && value <= max)) {
    throw Error("the value " + to_text(value) + " is out of range", where,
                "Choose one in [" + to_text(min) + ", " + to_text(max) + "].");
  }
}

template <class T>
std::string range_text(T min, T max, T lowest, T highest) {
  if (min <= lowest && max >= highest) return "";
  return "[" + (min <= lowest ? "-inf" : to_text(min)) + ", " + (max >= highest ? "inf" : to_text(max)) + "]";
}

std::string join(const std::vector<std::string>& words) {
  std::string all;
  for (const auto& w : words) all += (all.empty() ? "" : ", ") + w;
  return all;
}

// @throws Error for a key that is a list or a map
std::string name_of(const YAML::Node& node, const std::function<std::string(const YAML::Node&)>& where) {
  if (!node.IsScalar()) throw Error("a key is no word", where(node), "Write \"key: value\" lines.");
  return node.as<std::string>();
}

YAML::Node parse_list(const std::string& text, const std::string& where) {
  try {
    return YAML::Load(text);
  } catch (const YAML::Exception&) {
    throw Error("the list is not understood", where, "Write it as in [1, 2].");
  }
}

std::string line_of(const std::string& path, const YAML::Node& node) {
  return path + ", line " + std::to_string(node.Mark().line + 1);
}

}  // namespace

std::string nearest_word(const std::string& word, const std::vector<std::string>& known) {
  const std::string wanted = simplified(word);
  const auto distance = [&](const std::string& candidate) {
    const std::string other = simplified(candidate);
    // Half a name, or one with its unit, is nearer than another name with as many letters changed.
    const bool part = std::min(wanted.size(), other.size()) >= 3 &&
                      (other.find(wanted) != std::string::npos || wanted.find(other) != std::string::npos);
    const auto letters = static_cast<double>(edit_distance(wanted, other));
    return part ? std::min(letters, 0.5 + 0.1 * letters) : letters;
  };
  const auto best = std::min_element(known.begin(), known.end(),
                                     [&](const auto& a, const auto& b) { return distance(a) < distance(b); });
  return best == known.end() ? std::string() : *best;
}

std::string did_you_mean(const std::string& word, const std::vector<std::string>& known,
                         const std::string& prefix) {
  const std::string nearest = nearest_word(word, known);
  const std::string a = simplified(word), b = simplified(nearest);
  const bool part =
      std::min(a.size(), b.size()) >= 3 && (b.find(a) != std::string::npos || a.find(b) != std::string::npos);
  if (part || edit_distance(a, b) <= std::max<std::size_t>(1, std::min(a.size(), b.size()) / 2))
    return "Did you mean \"" + prefix + nearest + "\"?";
  return "Known are: " + join(known) + ".";
}

void ConfigSection::add(const std::string& key, double& value, const std::string& doc, double min,
                        double max) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  fields_.push_back({key, doc, range_text(min, max, -kInf, kInf),
                     [&value, min, max](const YAML::Node& n, const std::string& where) {
                       const auto v = convert<double>(n, where, "a number");
                       check_range(v, min, max, where);
                       value = v;
                     },
                     [&value] { return to_text(value); }});
}

void ConfigSection::add(const std::string& key, int& value, const std::string& doc, int min, int max) {
  using Limits = std::numeric_limits<int>;
  fields_.push_back({key, doc, range_text(min, max, Limits::min(), Limits::max()),
                     [&value, min, max](const YAML::Node& n, const std::string& where) {
                       const auto v = convert<int>(n, where, "a whole number");
                       check_range(v, min, max, where);
                       value = v;
                     },
                     [&value] { return to_text(value); }});
}

void ConfigSection::add(const std::string& key, bool& value, const std::string& doc) {
  fields_.push_back({key, doc, "true, false",
                     [&value](const YAML::Node& n, const std::string& where) {
                       value = convert<bool>(n, where, "true or false");
                     },
                     [&value] { return std::string(value ? "true" : "false"); }});
}

void ConfigSection::add(const std::string& key, std::string& value, const std::string& doc,
                        const std::vector<std::string>& choices) {
  fields_.push_back({key, doc, join(choices),
                     [&value, choices](const YAML::Node& n, const std::string& where) {
                       const auto v = convert<std::string>(n, where, "a word");
                       if (!choices.empty() &&
                           std::find(choices.begin(), choices.end(), v) == choices.end()) {
                         throw Error("the value \"" + v + "\" is not known", where,
                                     did_you_mean(v, choices) + " The choices are: " + join(choices) + ".");
                       }
                       value = v;
                     },
                     [&value] { return value.empty() ? std::string("\"\"") : value; }});
}

void ConfigSection::add(const std::string& key, std::vector<double>& values, const std::string& doc,
                        double min, double max) {
  fields_.push_back({key, doc, "list of numbers, each in [" + to_text(min) + ", " + to_text(max) + "]",
                     [&values, min, max](const YAML::Node& n, const std::string& where) {
                       const auto v =
                           convert<std::vector<double>>(n, where, "a list of numbers, as in [1, 2]");
                       for (const double each : v) check_range(each, min, max, where);
                       values = v;
                     },
                     [&values] {
                       std::string list;
                       for (const double v : values) list += (list.empty() ? "" : ", ") + to_text(v);
                       return "[" + list + "]";
                     }});
}

void Config::ignore(const std::vector<std::string>& section_names) {
  ignored_.insert(ignored_.end(), section_names.begin(), section_names.end());
}

void Config::load(const std::string& path) {
  std::error_code failed;
  const auto kind = std::filesystem::status(path, failed).type();
  if (kind == std::filesystem::file_type::directory) {
    throw Error("the configuration is a folder", path, "Name the YAML file in it.");
  }
  // Reading a pipe without a writer would block.
  if (!failed && kind != std::filesystem::file_type::regular &&
      kind != std::filesystem::file_type::not_found) {
    throw Error("the configuration is no file, but a pipe or a device", path,
                "Write it to a file; it is read several times.");
  }
  YAML::Node root;
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAllFromFile(path);
    if (documents.size() > 1) {
      throw Error("the configuration holds " + std::to_string(documents.size()) + " YAML documents", path,
                  "Keep one: remove the \"---\" between them and join their sections.");
    }
    if (!documents.empty()) root = documents.front();
  } catch (const YAML::BadFile&) {
    throw Error("the configuration cannot be read", path, "Check that the file exists and is readable.");
  } catch (const std::ios_base::failure&) {
    throw Error("the configuration cannot be read", path, "Check that the file exists and is readable.");
  } catch (const YAML::Exception& e) {
    throw Error("the configuration is not valid YAML", path + ", line " + std::to_string(e.mark.line + 1),
                "Mend it there: " + e.msg + ".");
  }
  if (!root.IsDefined() || root.IsNull()) return;
  if (!root.IsMap()) {
    throw Error("the configuration is not a map of sections", path,
                "Write \"section:\" lines with keys below them.");
  }
  apply(root, [&path](const YAML::Node& node) { return line_of(path, node); });
}

void Config::set(const std::string& assignment) {
  const std::size_t dot = assignment.find('.'), equals = assignment.find('=');
  if (equals == std::string::npos || dot == std::string::npos || dot == 0 || dot + 1 >= equals) {
    throw Error("the assignment is not understood", assignment,
                "Write section.key=value, e.g. frontend.max_range_m=80.");
  }
  YAML::Node section, root;
  const std::string value = assignment.substr(equals + 1);
  const YAML::Node list = value.rfind('[', 0) == 0 ? parse_list(value, assignment) : YAML::Node(value);
  section[assignment.substr(dot + 1, equals - dot - 1)] = list;
  root[assignment.substr(0, dot)] = section;
  apply(root, [&assignment](const YAML::Node&) { return assignment; });
}

void Config::apply(const YAML::Node& root, const std::function<std::string(const YAML::Node&)>& where) {
  std::vector<std::string> names = ignored_;
  for (const auto& s : sections_) names.push_back(s.name_);
  std::set<std::string> seen_sections;
  for (const auto& entry : root) {
    const auto name = name_of(entry.first, where);
    if (!seen_sections.insert(name).second) {
      throw Error("the section \"" + name + "\" is there twice", where(entry.first), "Join the two.");
    }
    const auto section =
        std::find_if(sections_.begin(), sections_.end(), [&](const auto& s) { return s.name_ == name; });
    if (section == sections_.end()) {
      if (std::find(ignored_.begin(), ignored_.end(), name) != ignored_.end()) continue;
      throw Error("unknown section \"" + name + "\"", where(entry.first), did_you_mean(name, names));
    }
    if (entry.second.IsNull()) continue;
    if (!entry.second.IsMap()) {
      throw Error("section \"" + name + "\" is not a map", where(entry.first),
                  "Write \"key: value\" lines, indented below it.");
    }
    std::set<std::string> seen_keys;
    for (const auto& item : entry.second) {
      const auto key = name_of(item.first, where);
      if (!seen_keys.insert(key).second) {
        throw Error("the key \"" + name + "." + key + "\" is there twice", where(item.first),
                    "Keep one of them.");
      }
      const auto field = std::find_if(section->fields_.begin(), section->fields_.end(),
                                      [&](const auto& f) { return f.key == key; });
      if (field == section->fields_.end()) {
        std::vector<std::string> keys;
        for (const auto& f : section->fields_) keys.push_back(f.key);
        // A key of that name in another section is more likely meant than a similar one here.
        for (const auto& other : sections_) {
          for (const auto& f : other.fields_) {
            if (f.key != key) continue;
            throw Error("unknown key \"" + name + "." + key + "\"", where(item.first),
                        "It belongs to the section \"" + other.name_ + "\": write it as " + other.name_ +
                            "." + key + ".");
          }
        }
        throw Error("unknown key \"" + name + "." + key + "\"", where(item.first),
                    did_you_mean(key, keys, name + "."));
      }
      field->read(item.second, where(item.first) + ", key \"" + name + "." + key + "\"");
    }
  }
}

std::string Config::print() const {
  std::ostringstream out;
  for (const auto& section : sections_) {
    out << section.name_ << ":\n";
    for (const auto& f : section.fields_) {
      out << "  # " << f.doc << (f.range.empty() ? "" : " (" + f.range + ")") << "\n";
      out << "  " << f.key << ": " << f.print() << "\n";
    }
  }
  return out.str();
}

}  // namespace hp2
