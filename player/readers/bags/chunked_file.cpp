#include "player/readers/bags/chunked_file.hpp"

#include <algorithm>

#include "common/error.hpp"
#include "common/transport/crc32.hpp"

namespace hp2 {
namespace {

constexpr std::uint64_t kMostExpanded = std::uint64_t{1} << 30;
constexpr std::size_t kRecentChunks = 3;
constexpr std::size_t kWindow = std::size_t{1} << 13;

}  // namespace

ChunkedFile::ChunkedFile(std::shared_ptr<const PartFile> file) : file_(std::move(file)) {
  chunks_.push_back({0, file_->size(), file_->size(), Compression::kNone, 0});
}

std::uint32_t ChunkedFile::add(const Chunk& chunk) {
  chunks_.push_back(chunk);
  return size() - 1;
}

std::string ChunkedFile::where(std::uint32_t chunk) const {
  return chunk == 0 ? file_->path()
                    : file_->path() + ", chunk at byte " + std::to_string(chunks_.at(chunk).at);
}

std::shared_ptr<const Expanded> ChunkedFile::expanded(std::uint32_t index, std::uint64_t least) const {
  const auto enough = [&](const Expanded& e) { return e.complete || e.bytes.size() >= least; };
  bool known = false;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (auto it = recent_.begin(); it != recent_.end(); ++it) {
      if (it->first != index) continue;
      known = true;
      if (!enough(*it->second)) break;
      recent_.splice(recent_.begin(), recent_, it);
      return recent_.front().second;
    }
  }
  const Chunk& c = chunks_.at(index);
  if (c.compression == Compression::kUnknown || c.expanded > kMostExpanded)
    throw Error(c.compression == Compression::kUnknown ? "a chunk's compression is not known"
                                                       : "a chunk claims an impossible size",
                where(index), "Record it again, or repair the recording.");
  // The head of a message is requested in parts. If more is requested, all of it will be needed.
  std::uint64_t most = known ? kMostExpanded : std::min(least + kWindow, kMostExpanded);
  if (most >= c.expanded / 2) most = std::max(c.expanded, most);
  auto made = std::make_shared<Expanded>(expand(
      c.compression, file_->read(c.at, static_cast<std::size_t>(c.size)), static_cast<std::size_t>(most)));
  if (made->bytes.size() == c.expanded) made->complete = true;  // nothing but the frame's end is missing
  if (made->complete && c.crc != 0 && crc32(made->bytes.data(), made->bytes.size()) != c.crc)
    throw Error("a chunk does not fit its checksum", where(index), "Copy the recording again.");
  // A chunk that cannot be expanded further is kept as it is, without another try.
  if (!made->complete && made->bytes.size() < most) made->complete = true;
  const std::lock_guard<std::mutex> lock(mutex_);
  recent_.remove_if([&](const auto& entry) { return entry.first == index; });
  recent_.emplace_front(index, made);
  while (recent_.size() > kRecentChunks) recent_.pop_back();
  return made;
}

std::string_view ChunkedFile::read(std::uint32_t index, std::uint64_t offset, std::size_t n,
                                   MessageBytes& memory) const {
  const Chunk& c = chunks_.at(index);
  if (c.compression == Compression::kNone) {
    if (offset >= c.size) return {};
    file_->read(c.at + offset, static_cast<std::size_t>(std::min<std::uint64_t>(n, c.size - offset)),
                memory.own);
    return memory.own;
  }
  if (offset > kMostExpanded) return {};
  memory.chunk = expanded(index, offset + n);
  const std::string_view bytes = memory.chunk->bytes;
  return offset >= bytes.size() ? std::string_view() : bytes.substr(static_cast<std::size_t>(offset), n);
}

std::uint64_t ChunkedFile::expanded_size(std::uint32_t index, MessageBytes& memory) const {
  const Chunk& c = chunks_.at(index);
  if (c.compression == Compression::kNone) return c.size;
  memory.chunk = expanded(index, kMostExpanded);
  return memory.chunk->bytes.size();
}

std::string_view RecordWindow::at(std::uint64_t offset, std::size_t n) {
  if (offset < begin_ || offset + n > begin_ + bytes_.size()) {
    begin_ = offset;
    bytes_ = file_.read(chunk_, offset, std::max(n, kWindow), memory_);
  }
  return bytes_.substr(static_cast<std::size_t>(offset - begin_), n);
}

}  // namespace hp2
