// Finished submaps for the back-end: kept until it has stored them, however often it dies.
#pragma once
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "common/transport/outbox.hpp"
#include "frontend/process/registration_worker.hpp"

namespace hp2 {

/// Owner of topic SUBMAP. Belongs to the bus's thread.
class KeptSubmaps {
 public:
  /// @param keep false: there is no back-end; submaps count as stored at once
  KeptSubmaps(Endpoint& endpoint, bool keep);

  /// Forgets everything; the session continues with submap `next_submap`, whose first scan is
  /// `next_sequence`.
  /// @param ended nothing will follow
  void begin(std::int64_t next_submap, std::int64_t next_sequence, bool ended);
  /// Takes finished submaps, in order. @param ended nothing will follow
  void add(std::vector<SubmapOut> submaps, bool ended);
  /// Drops what the back-end has stored. @return whether there was something
  bool drop_stored();

  bool empty() const { return kept_.empty(); }
  std::size_t size() const { return kept_.size(); }
  /// The back-end has been away for so long that no more should be cut.
  bool full() const;
  /// The oldest submap that the back-end can still be given; the next one to be cut if there is none.
  std::int64_t first() const { return kept_.empty() ? next_submap_ : kept_.front().id; }
  /// First scan that is in no stored submap.
  std::int64_t stored_sequence() const { return stored_sequence_; }

 private:
  void offer();

  const bool keep_;
  Outbox outbox_;
  std::deque<SubmapOut> kept_;
  std::size_t bytes_ = 0;
  std::int64_t next_submap_ = 0, stored_sequence_ = 0;
  bool ended_ = false;
};

}  // namespace hp2
