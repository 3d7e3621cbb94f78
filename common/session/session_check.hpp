// May a run begin or go on in a session folder? Asked before anything is started.
#pragma once
#include <map>
#include <string>

namespace hp2 {

/// Says in words what a back-end will do in `folder`: begin a session, or go on with the one that is there.
/// Changes nothing that is stored.
/// @param meta texts of this run; where the session keeps another one under "drive" or "configuration", it
/// was
///             begun with another drive or other settings
/// @throws Error if the session is complete, in use, damaged, of another version, or was begun otherwise
std::string check_session(const std::string& folder, const std::map<std::string, std::string>& meta);

}  // namespace hp2
