// The part of SQLite's C interface that the session store needs, with readable errors.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

struct sqlite3;
struct sqlite3_stmt;

namespace hp2::sqlite {

using Bytes = std::vector<std::uint8_t>;

/// An open database file.
class Database {
 public:
  enum class Mode { kReadWriteCreate, kReadWrite, kReadOnly, kImmutable };

  /// @throws Error if `path` cannot be opened so
  Database(const std::string& path, Mode mode);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  /// Runs statements that return nothing of interest. @throws Error
  void execute(const std::string& sql);
  /// First column of the first row as a number. @throws Error if there is none
  std::int64_t number(const std::string& sql);
  /// First column of the first row as text; empty if there is none.
  std::string text(const std::string& sql);
  const std::string& path() const { return path_; }
  /// Throws what SQLite's code `rc` means for the user.
  [[noreturn]] void fail(int rc) const;

 private:
  friend class Statement;
  sqlite3* handle_ = nullptr;
  std::string path_;
};

/// A prepared statement: bind in order, then step.
class Statement {
 public:
  Statement(Database& database, const std::string& sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(std::int64_t value);
  Statement& bind(double value);
  Statement& bind(const std::string& value);
  Statement& bind(const Bytes& value);  ///< `value` must live until the statement ran.
  /// Moves to the next row. @returns false at the end. @throws Error
  bool step();
  /// Runs to the end and resets the statement for the next set of values.
  void run();

  std::int64_t number(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  Bytes bytes(int column) const;

 private:
  void check(int rc) const;
  Database& database_;
  sqlite3_stmt* statement_ = nullptr;
  int next_ = 1;
};

/// Begins at construction; rolled back at destruction unless committed.
class Transaction {
 public:
  enum class Kind { kWrite, kRead };
  explicit Transaction(Database& database, Kind kind = Kind::kWrite);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Database& database_;
  bool open_ = true;
};

}  // namespace hp2::sqlite
