// Output files that appear whole or not at all: written without a name (where the file system can: nothing is
// left behind by a process that is killed) or under a temporary one beside the target, then renamed.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

namespace hp2 {

/// A file being written. Until commit() the target (an older version of it, maybe) is untouched; without
/// commit() the temporary file is removed again.
class AtomicFile {
 public:
  /// Opens a temporary file in the folder of `path`, which must exist.
  /// @throws Error if it cannot be made there
  explicit AtomicFile(std::string path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Appends bytes. @throws Error naming the file if they cannot be written (disk full)
  void write(const void* data, std::size_t size);
  void write(const std::string& text) { write(text.data(), text.size()); }
  /// Overwrites bytes from `offset` on, all of them written before; for counts in a header known only at the
  /// end.
  void patch(std::int64_t offset, const std::string& bytes);
  /// Makes everything durable and gives the file its name. @throws Error as write()
  void commit();

  /// Name under which the bytes lie until commit(); what was written can be read there after flush().
  const std::string& temporary_path() const { return temporary_path_; }
  void flush();

 private:
  [[noreturn]] void fail(const std::string& what) const;
  void make_name();
  void remove_name();
  std::string path_, temporary_path_;
  std::string name_;        // of the temporary file in the folder; empty: it has none
  void* stream_ = nullptr;  // FILE*
};

/// Writes `bytes` to `path` as one AtomicFile.
void write_file(const std::string& path, const std::string& bytes);

}  // namespace hp2
