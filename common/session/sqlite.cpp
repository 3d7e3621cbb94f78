#include "common/session/sqlite.hpp"

#include <cerrno>

#include <sqlite3.h>

#include "common/session/damage.hpp"

namespace hp2::sqlite {
namespace {

// "%", "?" and "#" have a meaning in an SQLite URI.
std::string escaped(const std::string& path) {
  std::string out;
  for (const char c : path) {
    switch (c) {
      case '%':
        out += "%25";
        break;
      case '?':
        out += "%3f";
        break;
      case '#':
        out += "%23";
        break;
      default:
        out += c;
    }
  }
  return out;
}

}  // namespace

Database::Database(const std::string& path, Mode mode) : path_(path) {
  int flags = SQLITE_OPEN_READONLY;
  if (mode == Mode::kReadWrite) flags = SQLITE_OPEN_READWRITE;
  if (mode == Mode::kReadWriteCreate) flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE;
  std::string name = path;
  if (mode == Mode::kImmutable) {
    flags |= SQLITE_OPEN_URI;
    // An absolute path or not, "file:" takes it as it stands.
    name = "file:" + escaped(path) + "?immutable=1";
  }
  const int rc = sqlite3_open_v2(name.c_str(), &handle_, flags, nullptr);
  if (rc != SQLITE_OK) {
    try {
      fail(rc);
    } catch (...) {
      sqlite3_close(handle_);
      throw;
    }
  }
  sqlite3_busy_timeout(handle_, 10000);
}

Database::~Database() { sqlite3_close_v2(handle_); }

void Database::execute(const std::string& sql) {
  const int rc = sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr);
  if (rc != SQLITE_OK) fail(rc);
}

std::int64_t Database::number(const std::string& sql) {
  Statement s(*this, sql);
  if (!s.step()) throw damage("a record is missing", path_);
  return s.number(0);
}

std::string Database::text(const std::string& sql) {
  Statement s(*this, sql);
  return s.step() ? s.text(0) : std::string();
}

void Database::fail(int rc) const {
  const std::string said = handle_ ? sqlite3_errmsg(handle_) : sqlite3_errstr(rc);
  const int kind = rc & 0xff;
  // Files beside the database, e.g. the index of its log, find the disk full in other words.
  const bool full = (kind == SQLITE_IOERR || kind == SQLITE_CANTOPEN) && handle_ != nullptr &&
                    sqlite3_system_errno(handle_) == ENOSPC;
  switch (full ? SQLITE_FULL : kind) {
    case SQLITE_FULL:
      throw Error("the disk is full (" + said + ")", path_,
                  "Free some space and start the back-end again; everything stored so far is kept.");
    case SQLITE_READONLY:
    case SQLITE_PERM:
      throw Error("the session cannot be written (" + said + ")", path_,
                  "Give write permission to its folder, or choose another one.");
    case SQLITE_CANTOPEN:
      throw Error("the session cannot be opened (" + said + ")", path_,
                  "Check that the folder exists and that you may read and write it.");
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      throw DamageError(
          "the session is damaged or is none (" + said + ")", path_,
          "Choose another session folder; `sqlite3 FILE .recover` may save what is left of this one.");
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      throw Error("the session is in use by another process (" + said + ")", path_,
                  "Stop the other back-end, or choose another session folder.");
    case SQLITE_IOERR:
      throw Error("the disk does not read or write (" + said + ")", path_,
                  "Check the disk and its free space.");
    default:
      throw Error("the session store failed (" + said + ")", path_, "Check the disk and the session folder.");
  }
}

Statement::Statement(Database& database, const std::string& sql) : database_(database) {
  check(sqlite3_prepare_v2(database.handle_, sql.c_str(), -1, &statement_, nullptr));
}

Statement::~Statement() { sqlite3_finalize(statement_); }

void Statement::check(int rc) const {
  if (rc != SQLITE_OK) database_.fail(rc);
}

Statement& Statement::bind(std::int64_t value) {
  check(sqlite3_bind_int64(statement_, next_++, value));
  return *this;
}

Statement& Statement::bind(double value) {
  check(sqlite3_bind_double(statement_, next_++, value));
  return *this;
}

Statement& Statement::bind(const std::string& value) {
  check(
      sqlite3_bind_text(statement_, next_++, value.data(), static_cast<int>(value.size()), SQLITE_TRANSIENT));
  return *this;
}

Statement& Statement::bind(const Bytes& value) {
  // A null pointer would bind NULL where an empty blob is meant.
  check(sqlite3_bind_blob64(statement_, next_++, value.empty() ? "" : static_cast<const void*>(value.data()),
                            value.size(), SQLITE_STATIC));
  return *this;
}

bool Statement::step() {
  const int rc = sqlite3_step(statement_);
  if (rc == SQLITE_ROW) return true;
  if (rc == SQLITE_DONE) return false;
  database_.fail(rc);
}

void Statement::run() {
  while (step()) {
  }
  check(sqlite3_reset(statement_));
  next_ = 1;
}

std::int64_t Statement::number(int column) const { return sqlite3_column_int64(statement_, column); }

double Statement::real(int column) const { return sqlite3_column_double(statement_, column); }

std::string Statement::text(int column) const {
  const auto* p = reinterpret_cast<const char*>(sqlite3_column_text(statement_, column));
  return p ? std::string(p, static_cast<std::size_t>(sqlite3_column_bytes(statement_, column)))
           : std::string();
}

Bytes Statement::bytes(int column) const {
  const auto* p = static_cast<const std::uint8_t*>(sqlite3_column_blob(statement_, column));
  return p ? Bytes(p, p + sqlite3_column_bytes(statement_, column)) : Bytes();
}

Transaction::Transaction(Database& database, Kind kind) : database_(database) {
  database_.execute(kind == Kind::kWrite ? "BEGIN IMMEDIATE" : "BEGIN");
}

Transaction::~Transaction() {
  if (!open_) return;
  try {
    database_.execute("ROLLBACK");
  } catch (const Error&) {
    // SQLite has rolled back by itself (it does so when the disk is full).
  }
}

void Transaction::commit() {
  database_.execute("COMMIT");
  open_ = false;
}

}  // namespace hp2::sqlite
