// The file of a session: created atomically, opened, upgraded to this version.
#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "common/session/sqlite.hpp"

namespace hp2 {

/// Version of the schema that is written; 1 and later are read.
inline constexpr int kSchemaVersion = 4;

/// Path of the database in a session's folder.
std::string session_path(const std::string& folder);

/// Whether a session was begun in `folder`. An empty or truncated file that a back-end left when it died, or
/// on a full disk, does not count: a back-end begins again there.
/// @throws Error if there is a file that no back-end has made, or that cannot be read
bool session_begun(const std::string& folder);

/// Opens the session in `folder` for its one writer. It is created if there is none, and one of an older
/// version is upgraded.
/// @param session_id number of a new session; 0: a random one
/// @throws Error if the folder cannot be written, the file is no session, is damaged, or is of a newer
/// version
std::unique_ptr<sqlite::Database> open_for_writing(const std::string& folder, std::int64_t session_id = 0);

/// Opens the session in `folder` without changing anything. @throws Error if there is none, or none that can
/// be read
std::unique_ptr<sqlite::Database> open_for_reading(const std::string& folder);

}  // namespace hp2
