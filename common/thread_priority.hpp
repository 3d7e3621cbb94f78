// Threads that give way to the registration.
#pragma once
#include <cerrno>
#include <sys/resource.h>

namespace hp2 {

/// Makes the calling thread alone (on Linux each has a niceness of its own) ten steps nicer: where all
/// processors are busy it gets a tenth of what others get, and where they are not it is as fast as ever.
inline void give_way() {
  errno = 0;
  const int nice = ::getpriority(PRIO_PROCESS, 0);
  if (errno == 0) ::setpriority(PRIO_PROCESS, 0, nice + 10);
}

}  // namespace hp2
