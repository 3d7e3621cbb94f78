#include "common/session/session_store.hpp"

#include <filesystem>
#include <optional>
#include <random>
#include <utility>

#include "backend/graph/motion_smoothing.hpp"
#include "backend/graph/scan_refinement.hpp"
#include "common/error.hpp"
#include "common/session/session_lock.hpp"
#include "common/session/sqlite.hpp"
#include "common/session/submap_codec.hpp"

namespace hp2 {
namespace {

constexpr int kApplicationId = 0x48503253;  // "HP2S"
constexpr int kSchemaVersion = 3;
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

std::vector<std::uint8_t> encode_constraint(const ClosureRecord& c) {
  BlobWriter out;
  out.put_pose(c.from_from_to);
  for (int i = 0; i < 36; ++i) out.put(c.information(i / 6, i % 6));
  return out.finish();
}

void decode_constraint(const std::vector<std::uint8_t>& bytes, const std::string& where, ClosureRecord& c) {
  BlobReader in(bytes, where);
  c.from_from_to = in.get_pose();
  for (int i = 0; i < 36; ++i) c.information(i / 6, i % 6) = in.get<double>();
}

Pose single_pose(const std::vector<std::uint8_t>& bytes, const std::string& where) {
  const std::vector<Pose> poses = decode_poses(bytes, where);
  if (poses.size() != 1)
    throw Error("the session is damaged: a pose is missing", where, "Choose another session folder.");
  return poses[0];
}

std::int64_t random_id() {
  std::random_device device;
  const std::uint64_t bits = (static_cast<std::uint64_t>(device()) << 32) ^ device();
  return static_cast<std::int64_t>(bits >> 1) | 1;  // positive
}

std::unique_ptr<sqlite::Database> open_database(const std::string& folder, SessionStore::Access access) {
  using Mode = sqlite::Database::Mode;
  namespace fs = std::filesystem;
  const std::string path = (fs::path(folder) / "session.sqlite").string();
  std::error_code ec;
  if (access == SessionStore::Access::kReadWrite) {
    fs::create_directories(folder, ec);
    if (ec) {
      throw Error("the session folder cannot be made (" + ec.message() + ")", folder,
                  "Choose a folder that you may write.");
    }
    return std::make_unique<sqlite::Database>(path, Mode::kReadWriteCreate);
  }
  if (!fs::exists(path, ec)) {
    throw Error("there is no session", path, "Name a folder in which a back-end has stored one.");
  }
  auto database = std::make_unique<sqlite::Database>(path, Mode::kReadOnly);
  try {
    database->number("SELECT count(*) FROM sqlite_master");
  } catch (const Error&) {
    // WAL needs its index beside the file: in a folder that cannot be written a closed session is read
    // without it.
    const auto wal_size = fs::file_size(path + "-wal", ec);
    if (!ec && wal_size > 0) throw;
    database = std::make_unique<sqlite::Database>(path, Mode::kImmutable);
  }
  return database;
}

}  // namespace

class SessionStore::Impl {
 public:
  Impl(const std::string& folder, Access access) : db(open_database(folder, access)) {
    if (access == Access::kReadWrite) lock.emplace(folder);
    if (access == Access::kReadWrite) {
      // Megabytes a submap: in pages larger than usual they take half the time. (A file that is there keeps
      // its own.)
      db->execute("PRAGMA page_size = 16384; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL");
      if (db->number("SELECT count(*) FROM sqlite_master") == 0) create();
    }
    if (db->number("PRAGMA application_id") != kApplicationId) {
      throw Error("the file is no session of this program", db->path(), "Choose another session folder.");
    }
    const auto version = db->number("PRAGMA user_version");
    if (version != kSchemaVersion) {
      throw Error("the session is of version " + std::to_string(version) + ", this program writes version " +
                      std::to_string(kSchemaVersion),
                  db->path(), "Read it with the release that wrote it, or choose another session folder.");
    }
    if (access == Access::kReadWrite) {
      const std::string check = db->text("PRAGMA quick_check(1)");
      if (check != "ok") {
        throw Error(
            "the session is damaged (" + check.substr(check.find('\n') + 1) + ")", db->path(),
            "Choose another session folder; `sqlite3 FILE .recover` may save what is left of this one.");
      }
    }
  }

  void create() {
    sqlite::Transaction t(*db);
    db->execute(kSchema);
    db->execute("PRAGMA application_id = " + std::to_string(kApplicationId));
    db->execute("PRAGMA user_version = " + std::to_string(kSchemaVersion));
    sqlite::Statement(*db, "INSERT INTO meta VALUES ('session_id', ?)")
        .bind(std::to_string(random_id()))
        .run();
    t.commit();
  }

  std::string where(const char* what, std::int64_t id) const {
    return db->path() + ", " + what + " " + std::to_string(id);
  }

  sqlite::Bytes blob(const char* table, const char* column, std::int64_t id) const {
    sqlite::Statement s(*db, std::string("SELECT ") + column + " FROM " + table + " WHERE id = ?");
    s.bind(id);
    if (!s.step()) {
      throw Error("the session has no such submap", where("submap", id), "Ask for one that is stored.");
    }
    return s.bytes(0);
  }

  void write_submap(const Submap& m, const sqlite::Bytes& place) {
    const auto keypose = encode_poses({m.odom_from_submap});
    const auto scans = encode_scans(m.scans);
    const auto points = encode_points(m);
    sqlite::Statement(*db, "INSERT INTO submaps VALUES (?, ?, ?, ?, ?, ?)")
        .bind(m.id)
        .bind(m.travelled_m)
        .bind(m.scans_skipped)
        .bind(static_cast<std::int64_t>(m.points.size()))
        .bind(static_cast<std::int64_t>(m.scans.size()))
        .bind(keypose)
        .run();
    sqlite::Statement(*db, "INSERT INTO submap_scans VALUES (?, ?)").bind(m.id).bind(scans).run();
    sqlite::Statement(*db, "INSERT INTO submap_points VALUES (?, ?)").bind(m.id).bind(points).run();
    sqlite::Statement(*db, "INSERT INTO submap_places VALUES (?, ?)").bind(m.id).bind(place).run();
  }

  void write_graph(const GraphState& g, const std::vector<std::size_t>& changed) {
    const auto map_from_odom = encode_poses({g.map_from_odom});
    const auto keyposes = encode_poses(g.map_from_submap);
    sqlite::Statement(*db, "INSERT OR REPLACE INTO graph VALUES (0, ?, ?, ?, ?)")
        .bind(g.revision)
        .bind(std::int64_t{g.ended})
        .bind(map_from_odom)
        .bind(keyposes)
        .run();
    sqlite::Statement s(*db, "INSERT OR REPLACE INTO closures VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
    for (const std::size_t i : changed) {
      const ClosureRecord& c = g.closures.at(i);
      const auto data = encode_constraint(c);
      s.bind(static_cast<std::int64_t>(i))
          .bind(c.from_submap)
          .bind(c.to_submap)
          .bind(std::int64_t{c.inliers})
          .bind(c.overlap)
          .bind(c.residual_m)
          .bind(std::int64_t{c.accepted})
          .bind(c.reason)
          .bind(data)
          .run();
    }
  }

  std::unique_ptr<sqlite::Database> db;
  std::optional<SessionLock> lock;
};

SessionStore::SessionStore(const std::string& folder, Access access)
    : impl_(std::make_unique<Impl>(folder, access)) {}
SessionStore::~SessionStore() = default;

std::int64_t SessionStore::session_id() const {
  return impl_->db->number("SELECT CAST(value AS INTEGER) FROM meta WHERE name = 'session_id'");
}

std::int64_t SessionStore::submap_count() const { return impl_->db->number("SELECT count(*) FROM submaps"); }

Submap SessionStore::read_submap(std::int64_t id, bool with_points) const {
  sqlite::Statement s(*impl_->db, "SELECT travelled_m, scans_skipped, keypose FROM submaps WHERE id = ?");
  s.bind(id);
  const std::string where = impl_->where("submap", id);
  if (!s.step()) throw Error("the session has no such submap", where, "Ask for one that is stored.");
  Submap m;
  m.id = id;
  m.travelled_m = s.real(0);
  m.scans_skipped = s.number(1);
  m.odom_from_submap = single_pose(s.bytes(2), where);
  m.scans = decode_scans(impl_->blob("submap_scans", "data", id), where);
  if (with_points) decode_points(impl_->blob("submap_points", "data", id), where, m);
  return m;
}

std::vector<std::uint8_t> SessionStore::read_place(std::int64_t id) const {
  return impl_->blob("submap_places", "data", id);
}

std::vector<std::uint8_t> SessionStore::read_frontend_state() const {
  sqlite::Statement s(*impl_->db, "SELECT state FROM frontend_state");
  return s.step() ? s.bytes(0) : sqlite::Bytes();
}

bool SessionStore::last_submap_stored() const {
  sqlite::Statement s(*impl_->db, "SELECT last FROM frontend_state");
  return s.step() && s.number(0) != 0;
}

GraphState SessionStore::read_graph() const {
  // One read transaction: a back-end that writes meanwhile cannot mix two revisions.
  sqlite::Transaction snapshot(*impl_->db, sqlite::Transaction::Kind::kRead);
  GraphState g;
  sqlite::Statement s(*impl_->db, "SELECT revision, ended, map_from_odom, map_from_submap FROM graph");
  if (!s.step()) return g;
  const std::string where = impl_->db->path() + ", graph";
  g.revision = s.number(0);
  g.ended = s.number(1) != 0;
  g.map_from_odom = single_pose(s.bytes(2), where);
  g.map_from_submap = decode_poses(s.bytes(3), where);

  sqlite::Statement c(*impl_->db,
                      "SELECT number, from_submap, to_submap, inliers, overlap, residual_m, accepted, "
                      "reason, constraint_data FROM closures ORDER BY number");
  while (c.step()) {
    ClosureRecord r;
    r.from_submap = c.number(1);
    r.to_submap = c.number(2);
    r.inliers = static_cast<int>(c.number(3));
    r.overlap = c.real(4);
    r.residual_m = c.real(5);
    r.accepted = c.number(6) != 0;
    r.reason = c.text(7);
    decode_constraint(c.bytes(8), impl_->where("closure", c.number(0)), r);
    g.closures.push_back(r);
  }
  std::vector<Submap> chain;
  for (std::size_t k = 0; k < g.map_from_submap.size(); ++k) {
    chain.push_back(read_submap(static_cast<std::int64_t>(k), false));
    if (k > 0) append_trajectory(chain[k - 1], &chain[k], g.map_from_submap, g.trajectory);
  }
  if (!chain.empty()) append_trajectory(chain.back(), nullptr, g.map_from_submap, g.trajectory);
  if (g.ended) {
    const auto meta = read_meta();
    const auto smoothed = meta.find(kScansSmoothed);
    if (smoothed != meta.end() && smoothed->second == "yes") smooth_trajectory(chain, g.trajectory);
  }
  return g;
}

void SessionStore::write_meta(const std::map<std::string, std::string>& values) {
  sqlite::Transaction t(*impl_->db);
  sqlite::Statement s(*impl_->db, "INSERT OR REPLACE INTO meta VALUES (?, ?)");
  for (const auto& [name, value] : values) {
    if (name == "session_id") continue;
    s.bind(name).bind(value).run();
  }
  t.commit();
}

std::map<std::string, std::string> SessionStore::read_meta() const {
  std::map<std::string, std::string> values;
  sqlite::Statement s(*impl_->db, "SELECT name, value FROM meta");
  while (s.step()) values[s.text(0)] = s.text(1);
  return values;
}

void SessionStore::commit(const SessionChange& change) {
  static const std::vector<std::uint8_t> kNone;
  sqlite::Transaction t(*impl_->db);
  if (change.submap) impl_->write_submap(*change.submap, change.place ? *change.place : kNone);
  if (change.graph) impl_->write_graph(*change.graph, change.changed_closures);
  if (change.frontend_state) {
    sqlite::Statement(*impl_->db, "INSERT OR REPLACE INTO frontend_state VALUES (0, ?, ?)")
        .bind(*change.frontend_state)
        .bind(std::int64_t{change.last})
        .run();
  }
  t.commit();
}

void SessionStore::limit_size(std::int64_t bytes) {
  const std::int64_t page = impl_->db->number("PRAGMA page_size");
  impl_->db->execute("PRAGMA max_page_count = " + std::to_string(bytes > 0 ? bytes / page : 4294967294));
}

}  // namespace hp2
