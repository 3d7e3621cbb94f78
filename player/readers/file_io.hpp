// Files and folders as the readers need them: whole files at once, names in natural order.
#pragma once
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace hp2 {

/// Largest file that is taken for one scan or one table [bytes]; anything larger is refused before memory is
/// asked for.
constexpr std::size_t kMaxFileBytes = std::size_t{1} << 30;

/// Bytes of one file. Keeps its memory from load to load, so that reading scan after scan allocates nothing.
class FileBuffer {
 public:
  /// Reads the whole of `path`.
  /// @throws Error if it is not a regular file, cannot be read, or is larger than kMaxFileBytes
  std::string_view load(const std::string& path);

 private:
  std::unique_ptr<char[]> data_;
  std::size_t capacity_ = 0;
};

/// Bytes of one file, a piece at a time: small enough that it is still in the processor's cache when it is
/// used.
class FilePieces {
 public:
  static constexpr std::size_t kPieceBytes = std::size_t{1} << 16;

  /// @throws Error as FileBuffer::load
  explicit FilePieces(const std::string& path);
  FilePieces(const FilePieces&) = delete;
  FilePieces& operator=(const FilePieces&) = delete;
  ~FilePieces();

  /// Size when it was opened [bytes].
  std::size_t size() const { return size_; }
  /// The next kPieceBytes; fewer at the file's end, none after it. Valid until this thread reads another one.
  /// @throws Error if the disk fails
  std::string_view next();

 private:
  std::string path_;
  std::size_t size_ = 0;
  int fd_;
  std::size_t left_;
};

/// A large file of which parts are read. Thread-safe.
class PartFile {
 public:
  /// @throws Error if `path` is no regular file or cannot be read
  explicit PartFile(const std::string& path) : PartFile(path, path) {}
  /// @param name to call the file by, where that is not `path`
  PartFile(const std::string& path, std::string name);
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  ~PartFile();

  const std::string& path() const { return path_; }
  int descriptor() const { return fd_; }
  /// Size when it was opened [bytes].
  std::uint64_t size() const { return size_; }
  /// Bytes [offset, offset + n); fewer at the file's end.
  /// @throws Error if more than kMaxFileBytes are asked for or the disk fails
  std::string read(std::uint64_t offset, std::size_t n) const;
  /// The same into a buffer that keeps its memory.
  void read(std::uint64_t offset, std::size_t n, std::string& out) const;

 private:
  std::string path_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
};

/// What a gzip file holds. @throws Error if it is damaged or larger than kMaxFileBytes
std::string expand_gzip(std::string_view bytes, const std::string& path);

/// The whole of a text file; see FileBuffer::load for the errors.
std::string read_text(const std::string& path);

/// The lines of `text` without their ends; a carriage return before the end belongs to the end.
std::vector<std::string_view> split_lines(std::string_view text);

/// The numbers in a line, separated by blanks, tabs, commas or semicolons. Other words become NaN.
std::vector<double> parse_numbers(std::string_view line);

/// Order in which people count: "scan2" before "scan10". Digits compare as numbers of any length.
bool natural_less(std::string_view a, std::string_view b);

/// Names of the regular files in `folder` that end in `extension` (with its dot, compared without regard to
/// case), in natural order; empty if the folder does not exist.
std::vector<std::string> list_files(const std::string& folder, const std::string& extension);

/// Whether `path` is a folder that exists, or a regular file that exists.
bool is_folder(const std::string& path);
bool is_file(const std::string& path);

/// Last part of a path, without a trailing slash.
std::string base_name(std::string path);
/// `path` without its last part; "." if there is only one part.
std::string parent_folder(std::string path);
/// A file's name without its extension.
std::string stem(const std::string& name);

}  // namespace hp2
