// May a run begin or go on in a session folder? Asked before anything is started.
#pragma once
#include <cstdint>
#include <map>
#include <string>

namespace hp2 {

/// Says in words what a back-end will do in `folder`: begin a session, or go on with the one that is there.
/// Changes nothing that is stored.
/// @param meta texts of this run. "drive" and "configuration" must be those that the session was begun with.
/// A session is complete when its graph has ended, and finished when its results have been written; until
/// then it is gone on with.
/// @throws Error if the session is finished, in use, damaged, of another version, or was begun otherwise
std::string check_session(const std::string& folder, const std::map<std::string, std::string>& meta);

/// Number of the session that is stored in `folder`; 0: none was begun there. @throws Error
std::int64_t stored_session_id(const std::string& folder);

}  // namespace hp2
