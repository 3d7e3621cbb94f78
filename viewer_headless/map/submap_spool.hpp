// Fetched submaps, kept in a file without a name in the output folder: a long session's points do not fit in
// memory.
#pragma once
#include <cstdint>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "common/submap.hpp"

namespace hp2 {

/// Encoded submaps on disk, by id. Thread-safe. The file is gone when the process is.
class SubmapSpool {
 public:
  /// @throws Error if no file can be created in `folder`
  explicit SubmapSpool(const std::string& folder);
  ~SubmapSpool();
  SubmapSpool(const SubmapSpool&) = delete;
  SubmapSpool& operator=(const SubmapSpool&) = delete;

  /// Appends the submap with id size(). @throws Error if the disk is full
  void append(const std::uint8_t* data, std::size_t size);
  std::int64_t size() const;
  /// @throws Error for an id that is not there
  Submap read(std::int64_t id, std::int64_t session_id) const;

 private:
  std::string folder_;
  int fd_ = -1;
  mutable std::mutex mutex_;
  std::vector<std::pair<std::int64_t, std::size_t>> places_;  // offset, bytes
  std::int64_t end_ = 0;
};

}  // namespace hp2
