// The error that a user can cause and mend: what went wrong, where, and what to do about it.
#pragma once
#include <stdexcept>
#include <string>

namespace hp2 {

/// Thrown for everything that the user can cause: bad input, bad configuration, a full disk. Its message is
/// made for a person: "what: where. What to do." Programs print it on stderr and exit with a status other
/// than 0.
class Error : public std::runtime_error {
 public:
  /// @param what  what went wrong, e.g. "the scan is truncated"
  /// @param where the file, key, channel or line, e.g. "velodyne/000012.bin, byte 1921024"
  /// @param todo  what the user can do about it; a full sentence
  Error(const std::string& what, const std::string& where, const std::string& todo)
      : std::runtime_error(what + ": " + where + ". " + todo) {}
};

}  // namespace hp2
