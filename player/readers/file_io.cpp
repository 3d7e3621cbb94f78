#include "player/readers/file_io.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <libdeflate.h>
#include <limits>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

#include "common/error.hpp"

namespace hp2 {
namespace fs = std::filesystem;
namespace {

/// A file descriptor that closes itself.
struct Descriptor {
  int fd;
  explicit Descriptor(int f) : fd(f) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd >= 0) ::close(fd);
  }
};

bool is_digit(char c) { return c >= '0' && c <= '9'; }

std::string_view take_digits(std::string_view s, std::size_t& i) {
  const std::size_t begin = i;
  while (i < s.size() && is_digit(s[i])) ++i;
  std::string_view digits = s.substr(begin, i - begin);
  while (digits.size() > 1 && digits.front() == '0') digits.remove_prefix(1);
  return digits;
}

std::string lower(std::string s) {
  for (char& c : s) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return s;
}

}  // namespace

namespace {

/// Opens `path` and gets its size.
int open_regular(const std::string& path, std::size_t& size) {
  // O_NONBLOCK: opening a named pipe must not wait for its writer; it is refused below.
  Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.fd < 0)
    throw Error("cannot open the file (" + std::string(std::strerror(errno)) + ")", path,
                "Check that it exists and may be read.");
  struct stat status {};
  if (::fstat(file.fd, &status) != 0 || !S_ISREG(status.st_mode))
    throw Error("not a regular file", path, "Give a data set's file.");
  size = static_cast<std::size_t>(status.st_size);
  if (size > kMaxFileBytes)
    throw Error("the file is too large (" + std::to_string(size) + " bytes)", path,
                "One scan or table may have at most " + std::to_string(kMaxFileBytes) + " bytes.");
  return std::exchange(file.fd, -1);
}

/// Reads `size` bytes; fewer if the file shrank since it was opened: what is left is what there is.
std::size_t read_bytes(int fd, char* to, std::size_t size, const std::string& path) {
  std::size_t done = 0;
  while (done < size) {
    const ssize_t n = ::read(fd, to + done, size - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      throw Error("cannot read the file (" + std::string(std::strerror(errno)) + ")", path,
                  "Check the disk it lies on.");
    if (n == 0) break;
    done += static_cast<std::size_t>(n);
  }
  return done;
}

}  // namespace

std::string_view FileBuffer::load(const std::string& path) {
  std::size_t size = 0;
  const Descriptor file(open_regular(path, size));
  if (size > capacity_ || !data_) {
    capacity_ = std::max<std::size_t>(size + size / 8, 4096);
    data_.reset(new char[capacity_]);
  }
  return {data_.get(), read_bytes(file.fd, data_.get(), size, path)};
}

FilePieces::FilePieces(const std::string& path) : path_(path), fd_(open_regular(path, size_)), left_(size_) {}

FilePieces::~FilePieces() { ::close(fd_); }

std::string_view FilePieces::next() {
  thread_local std::array<char, kPieceBytes> piece;
  const std::size_t wanted = std::min(left_, kPieceBytes);
  const std::size_t got = read_bytes(fd_, piece.data(), wanted, path_);
  left_ = got < wanted ? 0 : left_ - got;
  return {piece.data(), got};
}

PartFile::PartFile(const std::string& path, std::string name) : path_(std::move(name)) {
  fd_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat status {};
  if (fd_ < 0 || ::fstat(fd_, &status) != 0 || !S_ISREG(status.st_mode)) {
    if (fd_ >= 0) ::close(fd_);
    throw Error("cannot open the file", path_, "Check that it is a file that exists and may be read.");
  }
  size_ = static_cast<std::uint64_t>(status.st_size);
}

PartFile::~PartFile() { ::close(fd_); }

std::string PartFile::read(std::uint64_t offset, std::size_t n) const {
  std::string bytes;
  read(offset, n, bytes);
  return bytes;
}

void PartFile::read(std::uint64_t offset, std::size_t n, std::string& bytes) const {
  if (offset >= size_) return bytes.clear();
  n = static_cast<std::size_t>(std::min<std::uint64_t>(n, size_ - offset));
  if (n > kMaxFileBytes)
    throw Error("a message of " + std::to_string(n) + " bytes is too large", path_, "The file is damaged.");
  bytes.resize(n);
  std::size_t done = 0;
  while (done < n) {
    const ssize_t got = ::pread(fd_, bytes.data() + done, n - done, static_cast<off_t>(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0)
      throw Error("cannot read the file (" + std::string(std::strerror(errno)) + ")", path_,
                  "Check the disk it lies on.");
    if (got == 0) break;
    done += static_cast<std::size_t>(got);
  }
  bytes.resize(done);
}

std::string expand_gzip(std::string_view bytes, const std::string& path) {
  const std::unique_ptr<libdeflate_decompressor, void (*)(libdeflate_decompressor*)> expander(
      ::libdeflate_alloc_decompressor(), ::libdeflate_free_decompressor);
  // The size at the file's end may be wrong; deflate expands a byte to at most 1032.
  const std::size_t most = std::min(kMaxFileBytes, bytes.size() * 1032);
  std::uint32_t promised = 0;
  if (bytes.size() >= 18) std::memcpy(&promised, bytes.data() + bytes.size() - 4, sizeof(promised));
  std::string out(std::min<std::size_t>(promised, most), '\0');
  std::size_t size = 0;
  if (!expander || ::libdeflate_gzip_decompress(expander.get(), bytes.data(), bytes.size(), out.data(),
                                                out.size(), &size) != LIBDEFLATE_SUCCESS)
    throw Error("the gzip file is damaged", path, "Copy it again, or expand it with gunzip.");
  out.resize(size);
  return out;
}

std::string read_text(const std::string& path) {
  FileBuffer buffer;
  std::string_view text = buffer.load(path);
  if (text.substr(0, 3) == "\xef\xbb\xbf")
    text.remove_prefix(3);  // a byte order mark, as editors on Windows write
  return std::string(text);
}

std::vector<std::string_view> split_lines(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const std::size_t end = text.find('\n');
    std::string_view line = text.substr(0, end);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    lines.push_back(line);
    if (end == std::string_view::npos) break;
    text.remove_prefix(end + 1);
  }
  return lines;
}

std::vector<double> parse_numbers(std::string_view line) {
  constexpr std::string_view kSeparators = " \t,;";
  std::vector<double> numbers;
  std::size_t i = 0;
  while ((i = line.find_first_not_of(kSeparators, i)) != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(kSeparators, i), line.size());
    const char* first = line.data() + i + (line[i] == '+' ? 1 : 0);
    double value = 0.0;
    const auto [rest, error] = std::from_chars(first, line.data() + end, value);
    const bool good = error == std::errc() && rest == line.data() + end;
    numbers.push_back(good ? value : std::numeric_limits<double>::quiet_NaN());
    i = end;
  }
  return numbers;
}

bool natural_less(std::string_view a, std::string_view b) {
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const std::string_view x = take_digits(a, i);
      const std::string_view y = take_digits(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
    }
  }
  if (i < a.size() || j < b.size()) return j < b.size();
  return a < b;  // equal but for leading zeros: any fixed order
}

std::vector<std::string> list_files(const std::string& folder, const std::string& extension) {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    std::error_code ignored;
    if (lower(it->path().extension().string()) != extension || !it->is_regular_file(ignored)) continue;
    const std::string name = it->path().filename().string();
    if (name.front() != '.') names.push_back(name);
  }
  std::sort(names.begin(), names.end(), natural_less);
  return names;
}

bool is_folder(const std::string& path) {
  std::error_code error;
  return fs::is_directory(path, error);
}

bool is_file(const std::string& path) {
  std::error_code error;
  return fs::is_regular_file(path, error);
}

std::string base_name(std::string path) {
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  std::error_code error;
  // "." and ".." have no name of their own: ask what they stand for.
  if (path == "." || path == ".." || (path.size() > 2 && path.substr(path.size() - 3) == "/.."))
    path = fs::weakly_canonical(path, error).string();
  return fs::path(path).filename().string();
}

std::string parent_folder(std::string path) {
  while (path.size() > 1 && path.back() == '/') path.pop_back();
  const std::string parent = fs::path(path).parent_path().string();
  return parent.empty() ? "." : parent;
}

std::string stem(const std::string& name) { return fs::path(name).stem().string(); }

}  // namespace hp2
