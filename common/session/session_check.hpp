// Whether a run may begin or continue in a session folder; checked before anything is started.
#pragma once
#include <cstdint>
#include <map>
#include <string>

namespace hp2 {

/// Describes what a back-end will do in `folder`: begin a session, or continue the one that is there. Does
/// not change the session.
/// @param meta texts of this run. "drive" and "configuration" must be those that the session was begun with.
/// A session is complete when its graph has ended, and finished when its results have been written; until
/// then it is continued.
/// @throws Error if the session is finished, in use, damaged, of another version, or was begun otherwise
std::string check_session(const std::string& folder, const std::map<std::string, std::string>& meta);

/// Number of the session that is stored in `folder`; 0: none was begun there. @throws Error
std::int64_t stored_session_id(const std::string& folder);

}  // namespace hp2
