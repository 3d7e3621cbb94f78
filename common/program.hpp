// What every program of the project does alike: its log, its errors, its exit status.
#pragma once
#include <functional>
#include <string>

namespace hp2 {

/// Sets up the log (stderr, one line an event, the program's name in front) and runs `body`. An Error becomes
/// a message on stderr and status 1, any other exception a message that asks for a report and status 70.
/// @param name program's name as the user types it, e.g. "hp2_frontend"
/// @param body returns the exit status
int run_program(const std::string& name, const std::function<int()>& body);

/// Sets the level of the log: trace, debug, info, warn, error, off.
/// @throws Error for another word
void set_log_level(const std::string& level);

/// Largest resident set of this process so far [MB].
double peak_memory_mb();

/// Version of the project, e.g. "0.2.0".
std::string version();

}  // namespace hp2
