#include "viewer_headless/map/submap_spool.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>

#include "common/error.hpp"
#include "common/transport/convert.hpp"

namespace hp2 {

SubmapSpool::SubmapSpool(const std::string& folder) : folder_(folder) {
  std::string name = folder + "/.submaps-XXXXXX";
  fd_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd_ < 0) {
    throw Error("no file can be made (" + std::string(std::strerror(errno)) + ")", folder,
                "Choose an output folder that you may write.");
  }
  ::unlink(name.c_str());
}

SubmapSpool::~SubmapSpool() { ::close(fd_); }

void SubmapSpool::append(const std::uint8_t* data, std::size_t size) {
  const std::lock_guard<std::mutex> lock(mutex_);
  for (std::size_t done = 0; done < size;) {
    const ssize_t n =
        ::pwrite(fd_, data + done, size - done, static_cast<off_t>(end_ + static_cast<std::int64_t>(done)));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      throw Error("a submap cannot be kept (" + std::string(std::strerror(errno)) + ")", folder_,
                  "Make room on the disk and start the viewer again: the session is safe with the back-end.");
    }
    done += static_cast<std::size_t>(n);
  }
  places_.emplace_back(end_, size);
  end_ += static_cast<std::int64_t>(size);
}

std::int64_t SubmapSpool::size() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return static_cast<std::int64_t>(places_.size());
}

Submap SubmapSpool::read(std::int64_t id, std::int64_t session_id) const {
  std::pair<std::int64_t, std::size_t> place;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (id < 0 || id >= static_cast<std::int64_t>(places_.size())) {
      throw Error("there is no submap " + std::to_string(id), folder_, "Start the viewer again.");
    }
    place = places_[static_cast<std::size_t>(id)];
  }
  std::vector<std::uint8_t> bytes(place.second);
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::pread(fd_, bytes.data() + done, bytes.size() - done,
                              static_cast<off_t>(place.first + static_cast<std::int64_t>(done)));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  auto package = decode_submap(bytes.data(), done, session_id);
  if (!package)
    throw Error("submap " + std::to_string(id) + " cannot be read back", folder_, "Start the viewer again.");
  return std::move(package->submap);
}

}  // namespace hp2
