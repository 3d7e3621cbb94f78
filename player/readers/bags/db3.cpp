// ROS 2 bags in SQLite (.db3). Rows are visited in the table's own order, so that a file that is cut off
// gives what lies before the cut.
#include <algorithm>
#include <map>
#include <mutex>

#include <sqlite3.h>

#include "common/error.hpp"
#include "player/readers/bags/bag_file.hpp"

namespace hp2 {
namespace {

struct CloseDatabase {
  void operator()(sqlite3* db) const { sqlite3_close_v2(db); }
};
struct FinishStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};
struct CloseBlob {
  void operator()(sqlite3_blob* blob) const { sqlite3_blob_close(blob); }
};
using Database = std::unique_ptr<sqlite3, CloseDatabase>;
using Statement = std::unique_ptr<sqlite3_stmt, FinishStatement>;
using Blob = std::unique_ptr<sqlite3_blob, CloseBlob>;

/// `file:PATH?...` with what a URI gives a meaning written as %XX.
std::string uri_of(const std::string& path, bool immutable) {
  std::string uri = "file:";
  for (const char c : path) {
    constexpr const char* kDigits = "0123456789abcdef";
    if (c == '%' || c == '?' || c == '#') {
      const auto byte = static_cast<unsigned char>(c);
      uri += {'%', kDigits[byte >> 4], kDigits[byte & 15]};
    } else {
      uri += c;
    }
  }
  return uri + (immutable ? "?mode=ro&immutable=1" : "?mode=ro");
}

std::string text_of(sqlite3_stmt* statement, int column) {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement, column));
  return text ? std::string(text, static_cast<std::size_t>(sqlite3_column_bytes(statement, column))) : "";
}

class Db3 final : public BagFile {
 public:
  Db3(const PlainFile& plain, const WantedTypes& wanted) : file_(plain.file), wanted_(wanted) {
    open(plain.path, plain.path != plain.file->path());
    read_topics();
    read_messages();
  }

  std::string_view read(const MessageRef& ref, std::size_t most, MessageBytes& memory) const override {
    const std::lock_guard<std::mutex> lock(mutex_);
    steps_left_ = steps_budget();
    const auto row = static_cast<sqlite3_int64>(ref.at);
    // A blob that has failed once must not be used again.
    if (blob_ && sqlite3_blob_reopen(blob_.get(), row) != SQLITE_OK) blob_.reset();
    if (!blob_) {
      sqlite3_blob* blob = nullptr;
      if (sqlite3_blob_open(db_.get(), "main", "messages", "data", row, 0, &blob) != SQLITE_OK) fail(ref);
      blob_.reset(blob);
    }
    const auto size = static_cast<std::uint64_t>(sqlite3_blob_bytes(blob_.get()));
    if (size > file_->size()) fail(ref);
    const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(size, most));
    memory.own.resize(n);
    if (n > 0 && sqlite3_blob_read(blob_.get(), memory.own.data(), static_cast<int>(n), 0) != SQLITE_OK) {
      blob_.reset();
      fail(ref);
    }
    return memory.own;
  }

 private:
  [[noreturn]] void fail(const MessageRef& ref) const {
    throw Error("a message cannot be read (" + std::string(sqlite3_errmsg(db_.get())) + ")",
                file_->path() + ", row " + std::to_string(ref.at),
                "Copy the file again; `sqlite3 FILE .recover` gets out of a damaged one what can be.");
  }

  /// Steps of SQLite's machine that a sound file of this size may take: a damaged one must not keep it busy
  /// for good.
  std::int64_t steps_budget() const { return 1'000'000 + static_cast<std::int64_t>(file_->size()); }

  static int on_progress(void* self) {
    auto& left = static_cast<Db3*>(self)->steps_left_;
    left -= kProgressSteps;
    return left < 0 ? 1 : 0;
  }

  bool try_open(const std::string& path, bool immutable) {
    sqlite3* db = nullptr;
    const int code = sqlite3_open_v2(uri_of(path, immutable).c_str(), &db,
                                     SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX, nullptr);
    db_.reset(db);
    if (code != SQLITE_OK) return false;
    sqlite3_progress_handler(db, kProgressSteps, on_progress, this);
    // writable_schema: a file that is shorter than its header says is read as far as it goes. Nothing is
    // written.
    for (const char* pragma : {"PRAGMA trusted_schema=OFF", "PRAGMA cell_size_check=ON",
                               "PRAGMA writable_schema=ON", "PRAGMA mmap_size=0", "PRAGMA cache_size=-4096"})
      sqlite3_exec(db, pragma, nullptr, nullptr, nullptr);
    steps_left_ = steps_budget();
    return sqlite3_exec(db, "SELECT rowid FROM sqlite_master LIMIT 1", nullptr, nullptr, nullptr) ==
           SQLITE_OK;
  }

  void open(const std::string& path, bool temporary) {
    // A recorder that was killed leaves a journal that cannot be played back where nothing may be written.
    if (!temporary && try_open(path, false)) return;
    if (!temporary && (is_file(path + "-wal") || is_file(path + "-journal")))
      warnings_.push_back(path +
                          " was not closed, and its journal cannot be used: the last scans may be missing");
    if (try_open(path, true)) return;
    throw Error("not an SQLite file, or damaged (" + std::string(sqlite3_errmsg(db_.get())) + ")",
                file_->path(),
                "Copy the file again; `sqlite3 FILE .recover` gets out of a damaged one what can be.");
  }

  Statement prepare(const std::string& sql) const {
    sqlite3_stmt* statement = nullptr;
    sqlite3_prepare_v2(db_.get(), sql.c_str(), -1, &statement, nullptr);
    return Statement(statement);
  }

  bool is_table(const char* name) {
    const Statement s = prepare("SELECT 1 FROM sqlite_master WHERE type='table' AND rootpage>0 AND name='" +
                                std::string(name) + "'");
    return s && sqlite3_step(s.get()) == SQLITE_ROW;
  }

  void read_topics() {
    if (!is_table("topics") || !is_table("messages"))
      throw Error("the SQLite file holds no ROS 2 bag (no tables topics and messages)", file_->path(),
                  "Give a .db3 file that ros2 bag record has written.");
    Statement s = prepare("SELECT id, name, type, serialization_format FROM topics NOT INDEXED");
    const bool has_format = s != nullptr;
    if (!s) s = prepare("SELECT id, name, type FROM topics NOT INDEXED");
    while (s && sqlite3_step(s.get()) == SQLITE_ROW) {
      const std::string format = has_format ? text_of(s.get(), 3) : "cdr";
      const Encoding encoding = format == "cdr" || format.empty() ? Encoding::kCdr : Encoding::kOther;
      topic_of_[sqlite3_column_int64(s.get(), 0)] =
          topic_index(topics_, text_of(s.get(), 1), text_of(s.get(), 2), encoding, wanted_);
    }
  }

  void read_messages() {
    const Statement s = prepare("SELECT rowid, topic_id, timestamp FROM messages NOT INDEXED");
    steps_left_ = steps_budget();
    const std::uint64_t most = file_->size() / 8;  // a row takes more bytes than that
    std::uint64_t rows = 0;
    int code = SQLITE_ERROR;
    while (s && (code = sqlite3_step(s.get())) == SQLITE_ROW && ++rows <= most) {
      const auto topic = topic_of_.find(sqlite3_column_int64(s.get(), 1));
      if (topic == topic_of_.end()) continue;
      add_message(topics_[topic->second],
                  {sqlite3_column_int64(s.get(), 2) / 1000,
                   static_cast<std::uint64_t>(sqlite3_column_int64(s.get(), 0)), 0, 0});
    }
    if (code == SQLITE_DONE && !is_short()) return;
    warnings_.push_back(file_->path() + " is damaged or ends early: what cannot be read of it is left out");
    if (code != SQLITE_DONE && !s)
      throw Error("the table of messages cannot be read (" + std::string(sqlite3_errmsg(db_.get())) + ")",
                  file_->path(), "Copy the file again.");
    drop_unreadable();
  }

  std::uint64_t page_bytes() const {
    const std::string head = file_->read(0, 18);
    if (head.size() < 18) return 1;
    const auto size = static_cast<std::uint64_t>(static_cast<unsigned char>(head[16])) << 8 |
                      static_cast<unsigned char>(head[17]);
    return size == 1 ? 65536 : std::max<std::uint64_t>(size, 1);
  }

  /// Whether the file has fewer pages than its header says.
  bool is_short() const {
    const std::string head = file_->read(0, 32);
    if (head.size() < 32) return true;
    std::uint64_t pages = 0;
    for (std::size_t i = 28; i < 32; ++i) pages = pages << 8 | static_cast<unsigned char>(head[i]);
    return pages * page_bytes() > file_->size();
  }

  /// In a damaged file: leaves out the messages of which bytes are missing.
  void drop_unreadable() {
    MessageBytes memory;
    for (BagTopic& topic : topics_) {
      const auto unreadable = [&](const MessageRef& ref) {
        try {
          read(ref, kMaxFileBytes, memory);
          return false;
        } catch (const Error&) {
          return true;
        }
      };
      topic.refs.erase(std::remove_if(topic.refs.begin(), topic.refs.end(), unreadable), topic.refs.end());
    }
    // A page that is cut through reads as zeros behind the cut. It can only be of the last message.
    if (file_->size() % page_bytes() != 0) drop_last();
    for (BagTopic& topic : topics_)
      if (topic.wanted) topic.count = topic.refs.size();
  }

  void drop_last() {
    BagTopic* last = nullptr;
    for (BagTopic& topic : topics_)
      if (!topic.refs.empty() && (last == nullptr || topic.refs.back().at > last->refs.back().at))
        last = &topic;
    if (last != nullptr) last->refs.pop_back();
  }

  static constexpr int kProgressSteps = 1000;
  std::shared_ptr<const PartFile> file_;
  WantedTypes wanted_;
  std::map<sqlite3_int64, std::size_t> topic_of_;
  mutable std::mutex mutex_;  ///< Guards what follows while messages are read.
  mutable std::int64_t steps_left_ = 0;
  Database db_;
  mutable Blob blob_;
};

}  // namespace

std::unique_ptr<BagFile> open_db3(const PlainFile& file, const WantedTypes& wanted) {
  return std::make_unique<Db3>(file, wanted);
}

}  // namespace hp2
