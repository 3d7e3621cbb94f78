// Which of the scans that come without a handshake are the session's, and which number each has there. A
// producer's number, the stamp and the sender are judged together: none of them counts against the
// others.
#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "common/scan.hpp"

namespace hp2 {

/// Numbers live scans. Every scan that is left out is counted under its reason. Uses no network and no
/// clock.
class ScanStreams {
 public:
  /// The next scan gets this number, or a larger one.
  void set_next(std::int64_t next) { next_ = next; }
  std::int64_t next() const { return next_; }

  /// Takes one scan as it came.
  /// @param sender  number of the sending process; 0: not known (scans on HP2_SCAN name none)
  /// @param now_us  when it came, monotonic
  /// @return the scans whose turn it is, with the session's numbers: this one, none, or also some that were
  /// held
  ///         back until it was clear where they belong
  std::vector<Scan> take(Scan scan, std::int64_t sender, std::int64_t now_us);
  /// Scans held back whose turn has come because the stream before them has fallen silent.
  std::vector<Scan> poll(std::int64_t now_us);
  /// Whether scans came in the last 2 s.
  bool active(std::int64_t now_us) const;

  /// Counts since the last call, by name: duplicates, live_scans_other_sender, live_scans_late,
  /// live_scans_bad_number (left out); live_scans_renumbered, live_streams (taken).
  std::map<std::string, std::int64_t> take_counts();
  /// Remarks for the user since the last call; one of each kind in all.
  std::vector<std::string> take_remarks();

 private:
  // Scans of one sensor, one after another.
  struct Stream {
    std::string sensor;
    std::int64_t sender = 0;
    std::int64_t sequence = -1;        // of its last scan, as the producer counts (-1: it does not)
    std::int64_t other_sequence = -1;  // the last scan's own number, if it was not used
    std::int64_t utime = 0, duration_us = 0;
    std::int64_t period_us = 0;                       // usual step of the stamps; 0: not known
    int steps = 0;                                    // that it was learned from
    std::int64_t missing_first = 0, missing_end = 0;  // numbers left out at its last gap
    std::int64_t heard_us = 0, interval_us = 0;       // last arrival, usual time between two
    bool overlapped = false;  // the session's stream continued after this one had begun
    bool foreign = false;     // known for another sensor's
    std::deque<Scan> held;
  };
  enum class Fit { kNo, kNumber, kGap, kStamp };

  static Stream begin(const Scan& scan, std::int64_t sender, std::int64_t now_us);
  static bool same_source(const Stream& stream, const Scan& scan, std::int64_t sender);
  static Fit fit(const Stream& stream, const Scan& scan, std::int64_t sender);
  static void advance(Stream& stream, const Scan& scan, std::int64_t sender, std::int64_t now_us, Fit fit);
  bool duplicate(const Scan& scan);
  Scan numbered(Scan scan, std::int64_t skipped);
  std::vector<Scan> go_on(Scan scan, std::int64_t sender, std::int64_t now_us, Fit fit);
  std::vector<Scan> switch_to(std::size_t other, std::int64_t now_us);
  void tell_about_number(const Scan& scan);
  void leave_out(Stream& stream, const char* reason);
  void forget_silent(std::int64_t now_us);
  void remark(const std::string& kind, const std::string& text);

  std::int64_t next_ = 0;
  bool begun_ = false;
  Stream current_;
  std::deque<Stream> others_;
  std::int64_t last_us_ = 0;
  std::deque<std::uint64_t> recent_;  // fingerprints of the last scans
  std::map<std::string, std::int64_t> counts_;
  std::vector<std::string> remarks_;
  std::set<std::string> told_;
};

}  // namespace hp2
