// The error of stored bytes that are not what was written.
#pragma once
#include <string>

#include "common/error.hpp"

namespace hp2 {

/// Thrown for a flipped bit, a page that was lost, a file cut short. A disk that does not read is another
/// error.
class DamageError : public Error {
 public:
  using Error::Error;
};

/// @param what  what is wrong with it
/// @param where the file and what it is in it
inline DamageError damage(const std::string& what, const std::string& where) {
  return {"the session is damaged: " + what, where,
          "Write what is left of it with hp2_viewer_headless --session FOLDER --out OUT; choose another "
          "folder to "
          "register the drive anew."};
}

}  // namespace hp2
