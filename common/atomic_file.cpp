#include "common/atomic_file.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

#include "common/error.hpp"

namespace hp2 {

namespace {

// The permissions that fopen() would have given, in place of mkstemp's 0600.
mode_t default_mode() {
  const mode_t mask = umask(0);
  umask(mask);
  return 0666 & ~mask;
}

}  // namespace

AtomicFile::AtomicFile(std::string path) : path_(std::move(path)) {
  const std::string pattern = path_ + ".XXXXXX";
  std::vector<char> name(pattern.c_str(), pattern.c_str() + pattern.size() + 1);
  const int fd = mkstemp(name.data());
  if (fd < 0) fail("the file cannot be created");
  temporary_path_ = name.data();
  static const mode_t kMode = default_mode();
  const int changed = fchmod(fd, kMode);
  std::FILE* stream = changed == 0 ? fdopen(fd, "w+b") : nullptr;
  if (stream == nullptr) {
    const int reason = errno;
    close(fd);
    unlink(temporary_path_.c_str());
    errno = reason;
    fail("the file cannot be created");
  }
  stream_ = stream;
}

AtomicFile::~AtomicFile() {
  if (stream_ == nullptr) return;
  std::fclose(static_cast<std::FILE*>(stream_));
  unlink(temporary_path_.c_str());
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
  const bool closed = std::fclose(static_cast<std::FILE*>(stream_)) == 0;
  stream_ = nullptr;
  if (!closed || rename(temporary_path_.c_str(), path_.c_str()) != 0) {
    const int reason = errno;
    unlink(temporary_path_.c_str());
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
