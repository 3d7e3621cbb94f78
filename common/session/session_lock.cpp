#include "common/session/session_lock.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "common/error.hpp"

namespace hp2 {

SessionLock::SessionLock(const std::string& folder) {
  const std::string path = folder + "/session.lock";
  fd_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (fd_ < 0) {
    throw Error("the session cannot be written (" + std::string(std::strerror(errno)) + ")", folder,
                errno == ENOSPC
                    ? "Free some space and start the back-end again; everything stored so far is kept."
                    : "Give write permission to its folder, or choose another one.");
  }
  if (::flock(fd_, LOCK_EX | LOCK_NB) == 0) return;
  const int reason = errno;
  // A file system without locks (some network ones) is no reason to refuse.
  if (reason != EWOULDBLOCK) return;
  ::close(fd_);
  throw Error("the session is in use by another back-end", folder,
              "Stop that one first, or choose another session folder.");
}

SessionLock::~SessionLock() { ::close(fd_); }

}  // namespace hp2
