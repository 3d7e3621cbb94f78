#include "common/transport/message_loader.hpp"

#include <iterator>
#include <utility>

#include "common/thread_priority.hpp"

namespace hp2 {
namespace {

// Messages kept behind the newest one asked for: a reader asks again for pieces that it lost.
constexpr std::int64_t kBehind = 4;

}  // namespace

MessageLoader::MessageLoader(Load load, int ahead, int threads) : load_(std::move(load)), ahead_(ahead) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

MessageLoader::~MessageLoader() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stop_ = true;
  }
  wake_.notify_all();
  for (auto& thread : threads_) thread.join();
}

void MessageLoader::set_end(std::int64_t end) {
  const std::lock_guard<std::mutex> lock(mutex_);
  end_ = end;
  wake_.notify_all();
}

EncodedMessagePtr MessageLoader::get(std::int64_t id) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (id > wanted_ || id < wanted_ - kBehind) {
    wanted_ = id;
    for (auto it = ready_.begin(); it != ready_.end();) {
      const bool keep = it->first >= wanted_ - kBehind && it->first <= wanted_ + ahead_;
      it = keep ? std::next(it) : ready_.erase(it);
    }
    wake_.notify_all();
  }
  const auto it = ready_.find(id);
  if (it != ready_.end()) return it->second;
  missed_ = id;
  wake_.notify_all();
  return nullptr;
}

void MessageLoader::rethrow_error(std::int64_t last) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!errors_.empty() && errors_.begin()->first <= last) std::rethrow_exception(errors_.begin()->second);
}

std::optional<std::int64_t> MessageLoader::choose() const {
  const auto open = [this](std::int64_t id) {
    return id >= 0 && id < end_ && ready_.count(id) == 0 && busy_.count(id) == 0 && errors_.count(id) == 0;
  };
  if (open(missed_)) return missed_;
  for (std::int64_t id = wanted_; id <= wanted_ + ahead_; ++id) {
    if (open(id)) return id;
  }
  return std::nullopt;
}

void MessageLoader::work() {
  give_way();  // it is ahead of its readers, and waits for them most of the time
  std::unique_lock<std::mutex> lock(mutex_);
  while (!stop_) {
    const auto id = choose();
    if (!id) {
      wake_.wait(lock);
      continue;
    }
    busy_.insert(*id);
    lock.unlock();
    EncodedMessagePtr message;
    std::exception_ptr error;
    try {
      message = std::make_shared<EncodedMessage>(load_(*id));
    } catch (...) {
      error = std::current_exception();
    }
    lock.lock();
    busy_.erase(*id);
    if (message) {
      ready_[*id] = std::move(message);
      if (missed_ == *id) missed_ = -1;
    } else {
      errors_[*id] = error;
    }
  }
}

}  // namespace hp2
