// A disk that fails at the n-th write or sync: SQLite's own file system with a fault in it.
#pragma once
#include <csignal>
#include <cstdint>
#include <unistd.h>

#include <sqlite3.h>

namespace hp2::testing {

/// What happens at the n-th write, truncation or sync.
enum class DiskFault {
  kNone,
  kInputOutput,  ///< EIO, from then on.
  kFull,         ///< ENOSPC at every write from then on.
  kKill,         ///< SIGKILL of the process, in the middle of it.
};

/// The fault of this process's disk, and how many operations there were.
struct FailingDisk {
  DiskFault fault = DiskFault::kNone;
  std::int64_t at = 0;
  std::int64_t operations = 0;
};
inline FailingDisk& failing_disk() {
  static FailingDisk disk;
  return disk;
}

namespace failing {

struct File {
  sqlite3_file base;
  sqlite3_file* real;
};
inline sqlite3_file* real(sqlite3_file* f) { return reinterpret_cast<File*>(f)->real; }
inline sqlite3_vfs* original() {
  static sqlite3_vfs* vfs = sqlite3_vfs_find("unix");
  return vfs;
}

// SQLITE_OK, or what the operation fails with.
inline int next_operation(bool writes, int code) {
  FailingDisk& d = failing_disk();
  const bool now = d.operations++ >= d.at;
  if (!now || d.fault == DiskFault::kNone) return SQLITE_OK;
  if (d.fault == DiskFault::kInputOutput) return code;
  if (d.fault == DiskFault::kFull) return writes ? SQLITE_FULL : SQLITE_OK;
  return SQLITE_ABORT;
}

inline int write(sqlite3_file* f, const void* data, int n, sqlite3_int64 at) {
  const int rc = next_operation(true, SQLITE_IOERR_WRITE);
  if (rc == SQLITE_ABORT) {  // half of it is there
    real(f)->pMethods->xWrite(real(f), data, n / 2, at);
    ::kill(::getpid(), SIGKILL);
  }
  return rc != SQLITE_OK ? rc : real(f)->pMethods->xWrite(real(f), data, n, at);
}
inline int truncate(sqlite3_file* f, sqlite3_int64 size) {
  const int rc = next_operation(false, SQLITE_IOERR_TRUNCATE);
  if (rc == SQLITE_ABORT) ::kill(::getpid(), SIGKILL);
  return rc != SQLITE_OK ? rc : real(f)->pMethods->xTruncate(real(f), size);
}
inline int sync(sqlite3_file* f, int flags) {
  const int rc = next_operation(false, SQLITE_IOERR_FSYNC);
  if (rc == SQLITE_ABORT) ::kill(::getpid(), SIGKILL);
  return rc != SQLITE_OK ? rc : real(f)->pMethods->xSync(real(f), flags);
}

inline int open(sqlite3_vfs* /*vfs*/, const char* name, sqlite3_file* f, int flags, int* out) {
  static sqlite3_io_methods methods{
      2,
      [](sqlite3_file* g) { return real(g)->pMethods->xClose(real(g)); },
      [](sqlite3_file* g, void* p, int n, sqlite3_int64 at) {
        return real(g)->pMethods->xRead(real(g), p, n, at);
      },
      write,
      truncate,
      sync,
      [](sqlite3_file* g, sqlite3_int64* size) { return real(g)->pMethods->xFileSize(real(g), size); },
      [](sqlite3_file* g, int lock) { return real(g)->pMethods->xLock(real(g), lock); },
      [](sqlite3_file* g, int lock) { return real(g)->pMethods->xUnlock(real(g), lock); },
      [](sqlite3_file* g, int* held) { return real(g)->pMethods->xCheckReservedLock(real(g), held); },
      [](sqlite3_file* g, int op, void* p) { return real(g)->pMethods->xFileControl(real(g), op, p); },
      [](sqlite3_file* g) { return real(g)->pMethods->xSectorSize(real(g)); },
      [](sqlite3_file* g) { return real(g)->pMethods->xDeviceCharacteristics(real(g)); },
      [](sqlite3_file* g, int region, int size, int extend, void volatile** p) {
        return real(g)->pMethods->xShmMap(real(g), region, size, extend, p);
      },
      [](sqlite3_file* g, int at, int n, int lock) {
        return real(g)->pMethods->xShmLock(real(g), at, n, lock);
      },
      [](sqlite3_file* g) { real(g)->pMethods->xShmBarrier(real(g)); },
      [](sqlite3_file* g, int remove) { return real(g)->pMethods->xShmUnmap(real(g), remove); },
      nullptr,
      nullptr};
  auto* file = reinterpret_cast<File*>(f);
  file->real = reinterpret_cast<sqlite3_file*>(file + 1);
  file->real->pMethods = nullptr;
  const int rc = original()->xOpen(original(), name, file->real, flags, out);
  file->base.pMethods = file->real->pMethods != nullptr ? &methods : nullptr;
  return rc;
}

}  // namespace failing

/// From now on SQLite's files in this process are on failing_disk().
inline void use_failing_disk() {
  static sqlite3_vfs vfs = [] {
    sqlite3_vfs v = *failing::original();
    v.zName = "failing";
    v.szOsFile = static_cast<int>(sizeof(failing::File)) + v.szOsFile;
    v.xOpen = failing::open;
    return v;
  }();
  sqlite3_vfs_register(&vfs, 1);
}

}  // namespace hp2::testing
