#include "common/session/session_file.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <random>
#include <unistd.h>

#include "common/session/damage.hpp"
#include "common/session/session_records.hpp"

namespace hp2 {
namespace {

namespace fs = std::filesystem;
using Mode = sqlite::Database::Mode;

constexpr int kApplicationId = 0x48503253;  // "HP2S"
constexpr std::size_t kSqliteHeader = 100;
const std::string kMagic("SQLite format 3\0", 16);

// Whoever reads blobs by themselves: numbers that stand beside a blob are in it, too, under its checksum, and
// count from there. The columns are for people.
const char* const kSchema = R"(
CREATE TABLE meta (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE submaps (id INTEGER PRIMARY KEY, travelled_m REAL NOT NULL, scans_skipped INTEGER NOT NULL,
                      n_points INTEGER NOT NULL, n_scans INTEGER NOT NULL, keypose BLOB NOT NULL);
CREATE TABLE submap_scans (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE submap_points (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE submap_places (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE closures (number INTEGER PRIMARY KEY, from_submap INTEGER NOT NULL, to_submap INTEGER NOT NULL,
                       inliers INTEGER NOT NULL, overlap REAL NOT NULL, residual_m REAL NOT NULL,
                       accepted INTEGER NOT NULL, reason TEXT NOT NULL, constraint_data BLOB NOT NULL);
CREATE TABLE graph (id INTEGER PRIMARY KEY CHECK (id = 0), revision INTEGER NOT NULL, ended INTEGER NOT NULL,
                    map_from_odom BLOB NOT NULL, map_from_submap BLOB NOT NULL);
CREATE TABLE frontend_state (id INTEGER PRIMARY KEY CHECK (id = 0), state BLOB NOT NULL, last INTEGER NOT NULL);
)";
const char* const kSchemaOfDerived = R"(
CREATE TABLE trajectory (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE odometry_edges (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
)";

std::int64_t random_id() {
  std::random_device device;
  const std::uint64_t bits = (static_cast<std::uint64_t>(device()) << 32) ^ device();
  return static_cast<std::int64_t>(bits >> 1) | 1;  // positive
}

void check_version(sqlite::Database& db) {
  if (db.number("PRAGMA application_id") != kApplicationId) {
    throw Error("the file is no session of this program", db.path(), "Choose another session folder.");
  }
  const auto version = db.number("PRAGMA user_version");
  if (version < 1 || version > kSchemaVersion) {
    throw Error("the session is of version " + std::to_string(version) + ", this program writes version " +
                    std::to_string(kSchemaVersion),
                db.path(), "Read it with the release that wrote it, or choose another session folder.");
  }
}

bool is_empty(sqlite::Database& db) {
  return db.number("SELECT count(*) FROM sqlite_master") == 0 && db.number("PRAGMA application_id") == 0 &&
         db.number("PRAGMA user_version") == 0;
}

std::unique_ptr<sqlite::Database> open_existing(const std::string& path) {
  auto db = std::make_unique<sqlite::Database>(path, Mode::kReadOnly);
  try {
    is_empty(*db);
  } catch (const Error&) {
    // WAL needs its index beside the file: in a folder that cannot be written a closed session is read
    // without it.
    std::error_code ec;
    const auto wal_size = fs::file_size(path + "-wal", ec);
    if (!ec && wal_size > 0) throw;
    db = std::make_unique<sqlite::Database>(path, Mode::kImmutable);
  }
  return db;
}

// The change of a folder's entries is not on disk before the folder is.
void sync_folder(const std::string& folder) {
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

// Built beside its place and renamed when it is whole: a back-end that dies meanwhile leaves no half of a
// session.
void begin_session(const std::string& folder, std::int64_t session_id) {
  const std::string path = session_path(folder), unfinished = path + ".new";
  std::error_code ec;
  for (const char* end : {"", "-journal", "-wal", "-shm"}) fs::remove(unfinished + end, ec);
  {
    sqlite::Database db(unfinished, Mode::kReadWriteCreate);
    // Megabytes a submap: in pages larger than usual they take half the time.
    db.execute("PRAGMA page_size = 16384; PRAGMA journal_mode = MEMORY; PRAGMA synchronous = FULL");
    sqlite::Transaction t(db);
    db.execute(kSchema);
    db.execute(kSchemaOfDerived);
    db.execute("PRAGMA application_id = " + std::to_string(kApplicationId));
    db.execute("PRAGMA user_version = " + std::to_string(kSchemaVersion));
    sqlite::Statement(db, "INSERT INTO meta VALUES ('session_id', ?)")
        .bind(std::to_string(session_id != 0 ? session_id : random_id()))
        .run();
    t.commit();
  }
  // What an unfinished one left beside it is not this one's.
  for (const char* end : {"-journal", "-wal", "-shm"}) fs::remove(path + end, ec);
  if (::rename(unfinished.c_str(), path.c_str()) != 0) {
    throw Error("the session cannot be made (" + std::string(std::strerror(errno)) + ")", path,
                "Choose a folder that you may write.");
  }
  sync_folder(folder);
}

// Sessions of version 3 and older have no checksum on the front-end's state, and nothing of what follows from
// the submaps; places of before version 3 are laid out differently. The back-end computes both again.
void upgrade(sqlite::Database& db) {
  const auto version = db.number("PRAGMA user_version");
  if (version == kSchemaVersion) return;
  sqlite::Transaction t(db);
  db.execute(kSchemaOfDerived);
  if (version < 3) db.execute("DELETE FROM submap_places");
  sqlite::Bytes state;
  bool last = false, any = false;
  {
    sqlite::Statement s(db, "SELECT state, last FROM frontend_state");
    any = s.step();
    if (any) state = s.bytes(0), last = s.number(1) != 0;
  }
  if (any) {
    const auto bytes = encode_frontend_state(state, last);
    sqlite::Statement(db, "UPDATE frontend_state SET state = ?").bind(bytes).run();
  }
  db.execute("PRAGMA user_version = " + std::to_string(kSchemaVersion));
  t.commit();
}

}  // namespace

std::string session_path(const std::string& folder) { return (fs::path(folder) / "session.sqlite").string(); }

bool session_begun(const std::string& folder) {
  const std::string path = session_path(folder);
  std::error_code ec;
  if (!fs::exists(path, ec)) return false;
  std::string head(kSqliteHeader, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  if (head.size() < kSqliteHeader && kMagic.compare(0, head.size(), head, 0, kMagic.size()) == 0)
    return false;
  return !is_empty(*open_existing(path));
}

std::unique_ptr<sqlite::Database> open_for_writing(const std::string& folder, std::int64_t session_id) {
  if (!session_begun(folder)) begin_session(folder, session_id);
  auto db = std::make_unique<sqlite::Database>(session_path(folder), Mode::kReadWrite);
  check_version(*db);
  db->execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
  const std::string check = db->text("PRAGMA quick_check(1)");
  if (check != "ok") {
    throw DamageError(
        "the session is damaged (" + check.substr(check.find('\n') + 1) + ")", db->path(),
        "Choose another session folder; `sqlite3 FILE .recover` may save what is left of this one.");
  }
  upgrade(*db);
  return db;
}

std::unique_ptr<sqlite::Database> open_for_reading(const std::string& folder) {
  const std::string path = session_path(folder);
  std::error_code ec;
  if (!fs::exists(path, ec)) {
    throw Error("there is no session", path, "Name a folder in which a back-end has stored one.");
  }
  auto db = open_existing(path);
  if (is_empty(*db)) {
    throw Error("the session was never begun: its file is empty", path,
                "Start the back-end again: it begins it.");
  }
  check_version(*db);
  return db;
}

}  // namespace hp2
