// Reads the next scans of a drive in the background, so that the reader of scans waits for no disk.
#pragma once
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "player/scan_source.hpp"

namespace hp2 {

/// A window over a ScanSource: the scan asked for last and the `depth` scans after it are read by threads of
/// its own. Scans may be asked for in any order; asking for one outside the window moves the window there.
class ReadAhead {
 public:
  /// @param source  must outlive this object
  /// @param depth   scans to read ahead, at least 1; so many and one more are in memory at most
  /// @param threads that read, at least 1
  explicit ReadAhead(const ScanSource& source, std::size_t depth = 4, std::size_t threads = 1);
  ReadAhead(const ReadAhead&) = delete;
  ReadAhead& operator=(const ReadAhead&) = delete;
  /// Waits for reads under way to end.
  ~ReadAhead();

  /// Scan `index`, waiting for it if need be. The same scan for the same index, also when asked again.
  /// Several threads may call it; they take turns.
  /// @throws Error whatever ScanSource::read threw for this scan
  std::shared_ptr<const Scan> get(std::size_t index);

 private:
  struct Slot {
    bool done = false;
    std::shared_ptr<const Scan> scan;
    std::exception_ptr error;
  };

  void work();
  /// First scan of the window that nobody reads yet; size of the source if there is none.
  std::size_t next_to_read() const;

  const ScanSource& source_;
  const std::size_t depth_;
  std::mutex get_mutex_;  ///< Held during get(): two windows at once would chase each other.
  std::mutex mutex_;      ///< Guards what follows.
  std::condition_variable wanted_, arrived_;
  std::size_t begin_ = 0;  ///< The window is [begin_, begin_ + depth_].
  std::map<std::size_t, std::shared_ptr<Slot>> slots_;
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace hp2
