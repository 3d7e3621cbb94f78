#include "player/read_ahead.hpp"

#include <algorithm>

namespace hp2 {

ReadAhead::ReadAhead(const ScanSource& source, std::size_t depth, std::size_t threads)
    : source_(source), depth_(std::max<std::size_t>(depth, 1)) {
  for (std::size_t i = 0; i < std::max<std::size_t>(threads, 1); ++i)
    threads_.emplace_back([this] { work(); });
}

ReadAhead::~ReadAhead() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wanted_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::shared_ptr<const Scan> ReadAhead::get(std::size_t index) {
  const std::lock_guard<std::mutex> turn(get_mutex_);
  if (index >= source_.size())
    return std::make_shared<const Scan>(source_.read(index));  // its error is reported
  std::unique_lock<std::mutex> lock(mutex_);
  begin_ = index;
  // Scans that left the window are dropped; a running read of one ends in a slot that is not used.
  slots_.erase(slots_.begin(), slots_.lower_bound(index));
  slots_.erase(slots_.upper_bound(index + depth_), slots_.end());
  wanted_.notify_all();
  arrived_.wait(lock, [&] {
    const auto it = slots_.find(index);
    return it != slots_.end() && it->second->done;
  });
  const std::shared_ptr<Slot> slot = slots_.at(index);
  if (slot->error) std::rethrow_exception(slot->error);
  return slot->scan;
}

std::size_t ReadAhead::next_to_read() const {
  const std::size_t end = std::min(source_.size(), begin_ + depth_ + 1);
  for (std::size_t i = begin_; i < end; ++i)
    if (slots_.count(i) == 0) return i;
  return source_.size();
}

void ReadAhead::work() {
  std::unique_lock<std::mutex> lock(mutex_);
  while (true) {
    wanted_.wait(lock, [&] { return stop_ || next_to_read() < source_.size(); });
    if (stop_) return;
    const std::size_t index = next_to_read();
    const auto slot = std::make_shared<Slot>();
    slots_[index] = slot;
    lock.unlock();
    std::shared_ptr<const Scan> scan;
    std::exception_ptr error;
    try {
      scan = std::make_shared<const Scan>(source_.read(index));
    } catch (...) {
      error = std::current_exception();
    }
    lock.lock();
    slot->scan = std::move(scan);
    slot->error = error;
    slot->done = true;
    arrived_.notify_all();
  }
}

}  // namespace hp2
