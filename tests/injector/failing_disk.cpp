// A disk that fails, for a real process: preload this library (LD_PRELOAD) and it counts what the process
// does to the disk under a folder, and lets one of these operations fail. It knows nothing else of this
// project.
//   HP2_DISK_PROGRAM   only in processes of this name (without a path)
//   HP2_DISK_FOLDER    only files whose path begins so
//   HP2_DISK_FAULT     EIO (that operation), ENOSPC (from then on, whatever needs space), KILL (SIGKILL, a
//   write half done) HP2_DISK_AT        number of the operation that fails, from 0; all processes of a run
//   count together HP2_DISK_COUNTER   file of 8 bytes where they count
// Counted: opening to write, writes, synchronising, truncating, links, renaming, making folders. What stdio
// writes by itself is counted where the program calls fwrite, fflush and fclose.
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdarg>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <dlfcn.h>
#include <fcntl.h>
#include <string>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

namespace {

// The function that the process would have called without this library.
template <typename F>
F real(F, const char* name) {
  return reinterpret_cast<F>(dlsym(RTLD_NEXT, name));
}

std::string setting(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

struct Plan {
  std::string folder = setting("HP2_DISK_FOLDER"), fault = setting("HP2_DISK_FAULT");
  std::int64_t at = std::atoll(setting("HP2_DISK_AT").c_str());
  std::atomic<std::int64_t>* counter = nullptr;

  Plan() {
    if (setting("HP2_DISK_PROGRAM") != program_invocation_short_name || folder.empty()) return;
    const int fd = real(::open, "open")(setting("HP2_DISK_COUNTER").c_str(), O_RDWR | O_CLOEXEC, 0);
    if (fd < 0) return;
    void* page = mmap(nullptr, sizeof *counter, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (page != MAP_FAILED) counter = static_cast<std::atomic<std::int64_t>*>(page);
    ::close(fd);
  }
};

const Plan& plan() {
  static const Plan* const made = new Plan;  // files are closed after static objects are gone
  return *made;
}

bool watched(const char* path) {
  const Plan& p = plan();
  return p.counter != nullptr && path != nullptr &&
         std::strncmp(path, p.folder.c_str(), p.folder.size()) == 0;
}

bool watched(int fd) {
  if (plan().counter == nullptr) return false;
  char path[4096];
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  const ssize_t n = readlink(link.c_str(), path, sizeof path - 1);
  if (n < 0) return false;
  path[n] = '\0';
  return watched(path);
}

enum class Needs { kSpace, kNothing };

// Counts one operation. @return 0, or -1 with errno set: it fails. `half` is done before the process is
// killed
template <typename Half>
int next_operation(Needs needs, Half half) {
  const Plan& p = plan();
  const std::int64_t number = p.counter->fetch_add(1);
  if (p.fault == "EIO" && number == p.at) return errno = EIO, -1;
  if (p.fault == "ENOSPC" && number >= p.at && needs == Needs::kSpace) return errno = ENOSPC, -1;
  if (p.fault == "KILL" && number == p.at) {
    half();
    ::kill(::getpid(), SIGKILL);
  }
  return 0;
}
int next_operation(Needs needs) {
  return next_operation(needs, [] {});
}

constexpr int kWrites = O_WRONLY | O_RDWR | O_CREAT;

bool needs_mode(int flags) { return (flags & O_CREAT) != 0 || (flags & O_TMPFILE) == O_TMPFILE; }

int open_counted(const char* name, const char* path, int flags, mode_t mode) {
  if ((flags & kWrites) != 0 && watched(path) &&
      next_operation((flags & O_CREAT) != 0 ? Needs::kSpace : Needs::kNothing) != 0)
    return -1;
  return real(::open, name)(path, flags, mode);
}

template <typename Write>
ssize_t write_counted(int fd, std::size_t n, Write write) {
  if (watched(fd) && next_operation(Needs::kSpace, [&] { write(n / 2); }) != 0) return -1;
  return write(n);
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = needs_mode(flags) ? va_arg(more, mode_t) : 0;
  va_end(more);
  return open_counted("open", path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  va_list more;
  va_start(more, flags);
  const mode_t mode = needs_mode(flags) ? va_arg(more, mode_t) : 0;
  va_end(more);
  return open_counted("open64", path, flags, mode);
}
int mkostemp(char* path, int flags) {
  if (watched(path) && next_operation(Needs::kSpace) != 0) return -1;
  return real(::mkostemp, "mkostemp")(path, flags);
}

ssize_t write(int fd, const void* data, std::size_t n) {
  return write_counted(fd, n, [&](std::size_t k) { return real(::write, "write")(fd, data, k); });
}
ssize_t pwrite(int fd, const void* data, std::size_t n, off_t at) {
  return write_counted(fd, n, [&](std::size_t k) { return real(::pwrite, "pwrite")(fd, data, k, at); });
}
ssize_t pwrite64(int fd, const void* data, std::size_t n, off64_t at) {
  return write_counted(fd, n, [&](std::size_t k) { return real(::pwrite64, "pwrite64")(fd, data, k, at); });
}
std::size_t fwrite(const void* data, std::size_t size, std::size_t n, std::FILE* stream) {
  const auto write = [&](std::size_t k) { return real(::fwrite, "fwrite")(data, size, k, stream); };
  if (watched(fileno(stream)) &&
      next_operation(Needs::kSpace, [&] { write(n / 2), std::fflush(stream); }) != 0)
    return 0;
  return write(n);
}

int fflush(std::FILE* stream) {
  if (stream != nullptr && watched(fileno(stream)) && next_operation(Needs::kSpace) != 0) return EOF;
  return real(::fflush, "fflush")(stream);
}
int fclose(std::FILE* stream) {
  const bool fails = watched(fileno(stream)) && next_operation(Needs::kNothing) != 0;
  const int reason = errno;
  const int done = real(::fclose, "fclose")(stream);
  if (!fails) return done;
  errno = reason;
  return EOF;
}
int fsync(int fd) {
  return watched(fd) && next_operation(Needs::kNothing) != 0 ? -1 : real(::fsync, "fsync")(fd);
}
int fdatasync(int fd) {
  return watched(fd) && next_operation(Needs::kNothing) != 0 ? -1 : real(::fdatasync, "fdatasync")(fd);
}
int ftruncate(int fd, off_t size) {
  return watched(fd) && next_operation(Needs::kNothing) != 0 ? -1 : real(::ftruncate, "ftruncate")(fd, size);
}
int ftruncate64(int fd, off64_t size) {
  return watched(fd) && next_operation(Needs::kNothing) != 0 ? -1
                                                             : real(::ftruncate64, "ftruncate64")(fd, size);
}

int rename(const char* from, const char* to) {
  return watched(to) && next_operation(Needs::kSpace) != 0 ? -1 : real(::rename, "rename")(from, to);
}
int linkat(int from_folder, const char* from, int to_folder, const char* to, int flags) {
  return watched(to) && next_operation(Needs::kSpace) != 0
             ? -1
             : real(::linkat, "linkat")(from_folder, from, to_folder, to, flags);
}
int mkdir(const char* path, mode_t mode) {
  return watched(path) && next_operation(Needs::kSpace) != 0 ? -1 : real(::mkdir, "mkdir")(path, mode);
}

}  // extern "C"
