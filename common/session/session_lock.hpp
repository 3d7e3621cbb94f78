// One back-end a session: two that write the same one would each store its own submaps under the same
// numbers.
#pragma once
#include <string>

namespace hp2 {

/// Holds a session for this process alone, from construction to destruction; the kernel releases it if the
/// process dies. It is a lock on the file `session.lock` in the folder, which stays there, empty.
class SessionLock {
 public:
  /// @throws Error if another process holds the session, or the folder cannot be written
  explicit SessionLock(const std::string& folder);
  ~SessionLock();
  SessionLock(const SessionLock&) = delete;
  SessionLock& operator=(const SessionLock&) = delete;

 private:
  int fd_ = -1;
};

}  // namespace hp2
