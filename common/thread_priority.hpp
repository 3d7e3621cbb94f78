// Threads with a lower priority than the registration.
#pragma once
#include <cerrno>
#include <sys/resource.h>

namespace hp2 {

/// Raises the niceness of the calling thread by ten; on Linux each thread has its own. Where all processors
/// are busy it gets a tenth of what others get. Otherwise it is as fast as before.
inline void give_way() {
  errno = 0;
  const int nice = ::getpriority(PRIO_PROCESS, 0);
  if (errno == 0) ::setpriority(PRIO_PROCESS, 0, nice + 10);
}

}  // namespace hp2
