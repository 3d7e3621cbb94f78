// Files that are compiled into the program for the report; made by embed.cmake at build time.
#pragma once
#include <string>

namespace hp2::report_assets {

/// Chart.js as Debian packages it; empty if it was not there when the program was built.
std::string chart_library();
/// Our own script and style sheet.
std::string script();
std::string style();

}  // namespace hp2::report_assets
