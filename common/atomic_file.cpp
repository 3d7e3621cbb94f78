#include "common/atomic_file.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <random>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/error.hpp"

namespace hp2 {

namespace {

std::string path_of(int fd) { return "/proc/self/fd/" + std::to_string(fd); }

// The permissions that fopen() would have given, in place of mkstemp's 0600.
mode_t default_mode() {
  const mode_t mask = umask(0);
  umask(mask);
  return 0666 & ~mask;
}

// A file without a name beside `path`: nothing is left of it if the process is killed. -1: not possible here.
int open_unnamed(const std::string& path) {
  const auto folder = std::filesystem::path(path).parent_path();
  const int fd = open(folder.empty() ? "." : folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0666);
  if (fd < 0 || access(path_of(fd).c_str(), F_OK) == 0) return fd;
  close(fd);
  return -1;
}

// A file with a made-up name beside `path`, where the file system knows none without.
int open_named(const std::string& path, std::string& name) {
  name = path + ".XXXXXX";
  const int fd = mkostemp(name.data(), O_CLOEXEC);
  static const mode_t kMode = default_mode();
  if (fd < 0 || fchmod(fd, kMode) == 0) return fd;
  const int reason = errno;
  close(fd);
  unlink(name.c_str());
  errno = reason;
  return -1;
}

}  // namespace

AtomicFile::AtomicFile(std::string path) : path_(std::move(path)) {
  int fd = open_unnamed(path_);
  if (fd < 0) fd = open_named(path_, name_);
  if (fd < 0) fail("the file cannot be created");
  temporary_path_ = name_.empty() ? path_of(fd) : name_;
  stream_ = fdopen(fd, "w+b");
  if (stream_ != nullptr) return;
  const int reason = errno;
  close(fd);
  remove_name();
  errno = reason;
  fail("the file cannot be created");
}

AtomicFile::~AtomicFile() {
  if (stream_ == nullptr) return;
  std::fclose(static_cast<std::FILE*>(stream_));
  remove_name();
}

void AtomicFile::remove_name() {
  if (!name_.empty()) unlink(name_.c_str());
}

// A link cannot replace a file; a file renamed can.
void AtomicFile::make_name() {
  std::random_device random;
  for (int i = 0; i < 10 && name_.empty(); ++i) {
    const std::string name = path_ + "." + std::to_string(random());
    if (linkat(AT_FDCWD, temporary_path_.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0)
      name_ = name;
  }
  if (name_.empty()) fail("the file cannot be given its name");
}

void AtomicFile::fail(const std::string& what) const {
  const int reason = errno;
  std::string todo = "Check that the folder exists and may be written";
  if (reason == ENOSPC || reason == EDQUOT) todo = "Free some space on that disk";
  if (reason == EROFS) todo = "Choose a folder on a disk that is not read-only";
  throw Error(what + " (" + std::strerror(reason) + ")", path_, todo + ", then write it again.");
}

void AtomicFile::write(const void* data, std::size_t size) {
  if (size == 0) return;
  if (std::fwrite(data, 1, size, static_cast<std::FILE*>(stream_)) != size)
    fail("the file cannot be written");
}

void AtomicFile::patch(std::int64_t offset, const std::string& bytes) {
  auto* stream = static_cast<std::FILE*>(stream_);
  if (fseeko(stream, offset, SEEK_SET) != 0) fail("the file cannot be written");
  write(bytes);
  if (fseeko(stream, 0, SEEK_END) != 0) fail("the file cannot be written");
}

void AtomicFile::flush() {
  if (std::fflush(static_cast<std::FILE*>(stream_)) != 0) fail("the file cannot be written");
}

void AtomicFile::commit() {
  flush();
  // A file system may find out about a full disk as late as here; pipes and the like cannot be synchronised.
  if (fsync(fileno(static_cast<std::FILE*>(stream_))) != 0 && errno != EINVAL)
    fail("the file cannot be written");
  if (name_.empty()) make_name();
  const bool closed = std::fclose(static_cast<std::FILE*>(stream_)) == 0;
  stream_ = nullptr;
  if (!closed || rename(name_.c_str(), path_.c_str()) != 0) {
    const int reason = errno;
    remove_name();
    errno = reason;
    fail("the file cannot be written");
  }
}

void write_file(const std::string& path, const std::string& bytes) {
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

}  // namespace hp2
