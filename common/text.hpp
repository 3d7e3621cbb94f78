// Makes foreign text safe for a terminal, a log or a page.
#pragma once
#include <string>
#include <vector>

namespace hp2 {

/// `text` with "?" in place of what a terminal would obey or what would deceive its reader: control
/// characters (C0, DEL, C1), marks that turn the direction of writing, invisible characters, and bytes that
/// are not UTF-8.
std::string printable(const std::string& text);

/// A sentence that proposes the nearest of `known` to `word`, with `prefix` before it; all of them where none
/// is near.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known,
                         const std::string& prefix = "");

/// `word` quoted so that it can be pasted into a shell.
std::string shell_quoted(const std::string& word);

}  // namespace hp2
