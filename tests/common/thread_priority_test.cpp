#include "common/thread_priority.hpp"

#include <algorithm>
#include <thread>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

int niceness() { return ::getpriority(PRIO_PROCESS, 0); }

TEST(ThreadPriority, ThreadGivesWayAndNoOther) {
  const int before = niceness();
  int inside = before;
  std::thread([&] {
    give_way();
    inside = niceness();
  }).join();
  EXPECT_EQ(inside, std::min(19, before + 10));
  EXPECT_EQ(niceness(), before);
}

}  // namespace
}  // namespace hp2
