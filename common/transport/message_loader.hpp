// Messages prepared in the background: worker threads read, encode and checksum them ahead of requests, so
// that the bus's thread never waits for a disk.
#pragma once
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <limits>
#include <map>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <vector>

#include "common/transport/outbox.hpp"

namespace hp2 {

/// A cache of encoded messages around the one asked for last.
class MessageLoader {
 public:
  /// Makes message `id`. Called by several threads at once; may throw.
  using Load = std::function<EncodedMessage(std::int64_t id)>;

  /// @param ahead   messages kept ready after the one asked for last
  /// @param threads worker threads, at least 1
  MessageLoader(Load load, int ahead, int threads);
  ~MessageLoader();
  MessageLoader(const MessageLoader&) = delete;
  MessageLoader& operator=(const MessageLoader&) = delete;

  /// Messages 0 .. end-1 can be loaded.
  void set_end(std::int64_t end);
  /// The message if it is ready; otherwise it is made next. Never blocks.
  EncodedMessagePtr get(std::int64_t id);
  /// Throws what was thrown for the first message that cannot be made, if its id is at most `last`: the
  /// messages before it can still be fetched.
  void rethrow_error(std::int64_t last = std::numeric_limits<std::int64_t>::max());

 private:
  void work();
  std::optional<std::int64_t> choose() const;

  Load load_;
  const int ahead_;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::map<std::int64_t, EncodedMessagePtr> ready_;
  std::set<std::int64_t> busy_;
  std::int64_t end_ = 0, wanted_ = 0, missed_ = -1;
  std::map<std::int64_t, std::exception_ptr> errors_;  // by message
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace hp2
