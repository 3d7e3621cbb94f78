#include "player/readers/bags/compression.hpp"

#include <algorithm>
#include <bzlib.h>
#include <cstdlib>
#include <fcntl.h>
#include <functional>
#include <lz4frame.h>
#include <unistd.h>
#include <vector>
#include <zstd.h>

#include "common/error.hpp"

namespace hp2 {
namespace {

/// One step of a decompressor: takes from `in`, gives into [out, out + room).
struct Step {
  std::size_t taken = 0;
  std::size_t given = 0;
  bool ended = false;   ///< A frame is complete.
  bool failed = false;  ///< The bytes are damaged.
};

/// A decompressor that is fed piece by piece.
class Stream {
 public:
  virtual ~Stream() = default;
  virtual Step step(std::string_view in, char* out, std::size_t room) = 0;
};

class ZstdStream final : public Stream {
 public:
  ZstdStream() : context_(ZSTD_createDStream(), ZSTD_freeDStream) {
    if (!context_) throw Error("zstd does not start", "decompression", "Free some memory.");
  }
  Step step(std::string_view in, char* out, std::size_t room) override {
    ZSTD_inBuffer from{in.data(), in.size(), 0};
    ZSTD_outBuffer to{out, room, 0};
    const std::size_t hint = ZSTD_decompressStream(context_.get(), &to, &from);
    return {from.pos, to.pos, hint == 0, ZSTD_isError(hint) != 0};
  }

 private:
  std::unique_ptr<ZSTD_DStream, std::size_t (*)(ZSTD_DStream*)> context_;
};

class Lz4Stream final : public Stream {
 public:
  Lz4Stream() : context_(nullptr, LZ4F_freeDecompressionContext) {
    LZ4F_dctx* context = nullptr;
    if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION)))
      throw Error("lz4 does not start", "decompression", "Free some memory.");
    context_.reset(context);
  }
  Step step(std::string_view in, char* out, std::size_t room) override {
    std::size_t given = room;
    std::size_t taken = in.size();
    const std::size_t hint = LZ4F_decompress(context_.get(), out, &given, in.data(), &taken, nullptr);
    return {taken, given, hint == 0, LZ4F_isError(hint) != 0};
  }

 private:
  std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> context_;
};

class Bz2Stream final : public Stream {
 public:
  Bz2Stream() {
    if (BZ2_bzDecompressInit(&stream_, 0, 0) != BZ_OK)
      throw Error("bzip2 does not start", "decompression", "Free some memory.");
  }
  Bz2Stream(const Bz2Stream&) = delete;
  Bz2Stream& operator=(const Bz2Stream&) = delete;
  ~Bz2Stream() override { BZ2_bzDecompressEnd(&stream_); }
  Step step(std::string_view in, char* out, std::size_t room) override {
    constexpr std::size_t kMost = 1U << 30;
    stream_.next_in = const_cast<char*>(in.data());
    stream_.avail_in = static_cast<unsigned>(std::min(in.size(), kMost));
    stream_.next_out = out;
    stream_.avail_out = static_cast<unsigned>(std::min(room, kMost));
    const auto had_in = stream_.avail_in;
    const auto had_out = stream_.avail_out;
    const int code = BZ2_bzDecompress(&stream_);
    return {had_in - stream_.avail_in, had_out - stream_.avail_out, code == BZ_STREAM_END,
            code != BZ_STREAM_END && code != BZ_OK};
  }

 private:
  bz_stream stream_{};
};

std::unique_ptr<Stream> make_stream(Compression compression) {
  if (compression == Compression::kZstd) return std::make_unique<ZstdStream>();
  if (compression == Compression::kLz4) return std::make_unique<Lz4Stream>();
  return std::make_unique<Bz2Stream>();
}

/// One frame whose size is known and credible: faster than in pieces. False if it is none, or damaged.
bool expand_zstd_at_once(std::string_view packed, std::size_t most, Expanded& out) {
  const unsigned long long size = ZSTD_getFrameContentSize(packed.data(), packed.size());
  if (size == ZSTD_CONTENTSIZE_UNKNOWN || size == ZSTD_CONTENTSIZE_ERROR || size > most ||
      size > 64 * packed.size() + (std::size_t{1} << 20))
    return false;
  thread_local const std::unique_ptr<ZSTD_DCtx, std::size_t (*)(ZSTD_DCtx*)> context(ZSTD_createDCtx(),
                                                                                     ZSTD_freeDCtx);
  if (!context) return false;
  out.bytes.resize(static_cast<std::size_t>(size));
  const std::size_t frame = ZSTD_findFrameCompressedSize(packed.data(), packed.size());
  if (ZSTD_isError(frame)) return false;
  const std::size_t given =
      ZSTD_decompressDCtx(context.get(), out.bytes.data(), out.bytes.size(), packed.data(), frame);
  out.complete = !ZSTD_isError(given) && given == out.bytes.size();
  return out.complete;
}

void write_all(int fd, const char* bytes, std::size_t n, const std::string& path) {
  while (n > 0) {
    const ssize_t done = ::write(fd, bytes, n);
    if (done <= 0)
      throw Error(
          "the temporary file for a compressed recording cannot be written", path,
          "Free space there, set TMPDIR to a folder with space, or decompress the recording yourself.");
    bytes += done;
    n -= static_cast<std::size_t>(done);
  }
}

/// Expands the whole of `packed` into `fd`; whether it ended as it should.
bool expand_file(const PartFile& packed, Compression compression, int fd, const std::string& folder) {
  constexpr std::size_t kPiece = std::size_t{1} << 20;
  std::unique_ptr<Stream> stream = make_stream(compression);
  std::vector<char> out(kPiece);
  bool ended = false;
  std::string piece;
  for (std::uint64_t at = 0; at < packed.size(); at += piece.size()) {
    piece = packed.read(at, kPiece);
    if (piece.empty()) return false;
    std::string_view left = piece;
    for (bool full = false; !left.empty() || full;) {
      if (ended) {  // another frame follows
        stream = make_stream(compression);
        ended = false;
      }
      const Step step = stream->step(left, out.data(), out.size());
      write_all(fd, out.data(), step.given, folder);
      if (step.failed) return false;
      left.remove_prefix(step.taken);
      ended = step.ended;
      full = !ended && step.given == out.size();
      if (step.taken == 0 && step.given == 0 && !ended) break;
    }
  }
  return ended;
}

}  // namespace

Compression compression_of_name(std::string_view name) {
  if (name.empty() || name == "none") return Compression::kNone;
  if (name == "zstd") return Compression::kZstd;
  if (name == "lz4") return Compression::kLz4;
  if (name == "bz2") return Compression::kBz2;
  return Compression::kUnknown;
}

Compression compression_of_bytes(std::string_view bytes) {
  if (bytes.substr(0, 4) == "\x28\xb5\x2f\xfd") return Compression::kZstd;
  if (bytes.substr(0, 4) == "\x04\x22\x4d\x18") return Compression::kLz4;
  if (bytes.substr(0, 3) == "BZh") return Compression::kBz2;
  return Compression::kNone;
}

Expanded expand(Compression compression, std::string_view packed, std::size_t most, std::string reuse) {
  Expanded out;
  out.bytes = std::move(reuse);
  if (compression == Compression::kZstd && expand_zstd_at_once(packed, most, out)) return out;
  const std::unique_ptr<Stream> stream = make_stream(compression);
  if (out.bytes.size() > most) out.bytes.resize(most);
  std::size_t used = 0;
  while (used < most) {
    if (used == out.bytes.size())
      out.bytes.resize(std::min(std::max({2 * used, 4 * packed.size(), std::size_t{4096}}), most));
    const Step step = stream->step(packed, out.bytes.data() + used, out.bytes.size() - used);
    if (step.failed) break;
    used += step.given;
    packed.remove_prefix(step.taken);
    out.complete = step.ended;
    if (step.ended || (step.taken == 0 && step.given == 0)) break;
  }
  out.bytes.resize(used);
  return out;
}

PlainFile open_plain(const std::string& path) {
  PlainFile plain;
  plain.path = path;
  plain.file = std::make_shared<const PartFile>(path);
  const Compression compression = compression_of_bytes(plain.file->read(0, 4));
  if (compression == Compression::kNone) return plain;
  const char* variable = std::getenv("TMPDIR");
  const std::string folder = variable && *variable ? variable : "/tmp";
  plain.path = folder + "/hp2_recording_XXXXXX";
  const int fd = ::mkstemp(plain.path.data());
  if (fd < 0)
    throw Error("no temporary file can be made for the compressed recording " + path, folder,
                "Set TMPDIR to a folder with space, or decompress the recording yourself.");
  plain.temporary = std::shared_ptr<const void>(nullptr, [name = plain.path, fd](const void*) {
    ::close(fd);
    ::unlink(name.c_str());
  });
  if (!expand_file(*plain.file, compression, fd, folder))
    plain.warning = path + " is damaged or ends early: what could be decompressed is read";
  plain.file = std::make_shared<const PartFile>(plain.path, path);
  return plain;
}

}  // namespace hp2
