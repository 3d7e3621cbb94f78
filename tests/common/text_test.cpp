#include "common/text.hpp"

#include <array>
#include <cstdio>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

TEST(Printable, KeepsOrdinaryTextOfAnyLanguage) {
  const std::string text = "scan 7: 5 \u00b5s, \u00fcberfahren, \u8d70\u884c, \U0001F697";
  EXPECT_EQ(printable(text), text);
}

TEST(Printable, ReplacesWhatATerminalObeysOrWhatDeceives) {
  EXPECT_EQ(printable("a\x1b[2Jb\nc\x7f"), "a?[2Jb?c?");
  EXPECT_EQ(printable("a\u009b2Jb"), "a?2Jb");  // CSI as one C1 character
  EXPECT_EQ(printable("a\x9b"
                      "2J"),
            "a?2J");                                                   // and as a raw byte
  EXPECT_EQ(printable("\u202eabc\u2066d\u200fe\u061c"), "?abc?d?e?");  // direction of writing
  EXPECT_EQ(printable("a\u200bb\ufeffc\u2028d"), "a?b?c?d");
}

TEST(Printable, ReplacesBytesThatAreNoUtf8) {
  EXPECT_EQ(printable("\xc0\xaf"), "??");
  EXPECT_EQ(printable("\xed\xa0\x80"), "???");
  EXPECT_EQ(printable("ab\xe2\x82"), "ab??");
}

TEST(ShellQuoted, GivesTheWordBackThroughAShell) {
  for (const std::string word :
       {"plain/path_1.bin", "with space", "$(touch x)", "it's", "`id`;&|<>*?!", "", "-n", "\\"}) {
    const std::string command = "printf '%s' " + shell_quoted(word);
    std::FILE* pipe = ::popen(command.c_str(), "r");
    ASSERT_NE(pipe, nullptr);
    std::array<char, 100> buffer{};
    const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), pipe);
    ::pclose(pipe);
    EXPECT_EQ(std::string(buffer.data(), n), word);
  }
}

}  // namespace
}  // namespace hp2
