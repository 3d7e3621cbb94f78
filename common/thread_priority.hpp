// Threads that give way to the registration.
#pragma once
#include <cerrno>
#include <sys/resource.h>

namespace hp2 {

/// Makes the calling thread ten steps nicer; on Linux each thread has a niceness of its own. Where all
/// processors are busy it gets a tenth of what others get. Otherwise it is as fast as before.
inline void give_way() {
  errno = 0;
  const int nice = ::getpriority(PRIO_PROCESS, 0);
  if (errno == 0) ::setpriority(PRIO_PROCESS, 0, nice + 10);
}

}  // namespace hp2
