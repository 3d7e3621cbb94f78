#include "common/session/session_store.hpp"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <optional>
#include <utility>

#include "common/session/damage.hpp"
#include "common/session/session_file.hpp"
#include "common/session/session_lock.hpp"
#include "common/session/session_records.hpp"
#include "common/session/sqlite.hpp"
#include "common/session/submap_codec.hpp"

namespace hp2 {
class SessionStore::Impl {
 public:
  Impl(const std::string& folder, Access access, std::int64_t session_id) {
    if (access == Access::kReadWrite) {
      std::error_code ec;
      std::filesystem::create_directories(folder, ec);
      if (ec) {
        throw Error("the session folder cannot be made (" + ec.message() + ")", folder,
                    "Choose a folder that you may write.");
      }
      lock.emplace(folder);
    }
    db = access == Access::kReadWrite ? open_for_writing(folder, session_id) : open_for_reading(folder);
    version = db->number("PRAGMA user_version");
  }

  std::string where(const char* what, std::int64_t id) const {
    return db->path() + ", " + what + " " + std::to_string(id);
  }

  std::optional<sqlite::Bytes> find(const char* table, std::int64_t id) const {
    sqlite::Statement s(*db, std::string("SELECT data FROM ") + table + " WHERE id = ?");
    s.bind(id);
    if (!s.step()) return std::nullopt;
    return s.bytes(0);
  }

  sqlite::Bytes blob(const char* table, std::int64_t id) const {
    auto bytes = find(table, id);
    if (!bytes) throw damage("a record is missing", where(table, id));
    return std::move(*bytes);
  }

  void put(const char* table, std::int64_t id, const sqlite::Bytes& bytes) {
    sqlite::Statement(*db, std::string("INSERT OR REPLACE INTO ") + table + " VALUES (?, ?)")
        .bind(id)
        .bind(bytes)
        .run();
  }

  void write_submap(const Submap& m, const sqlite::Bytes& place) {
    const auto keypose = encode_pose_with(m.odom_from_submap, m.travelled_m, m.scans_skipped);
    sqlite::Statement(*db, "INSERT INTO submaps VALUES (?, ?, ?, ?, ?, ?)")
        .bind(m.id)
        .bind(m.travelled_m)
        .bind(m.scans_skipped)
        .bind(static_cast<std::int64_t>(m.points.size()))
        .bind(static_cast<std::int64_t>(m.scans.size()))
        .bind(keypose)
        .run();
    put("submap_scans", m.id, encode_scans(m.scans));
    put("submap_points", m.id, encode_points(m));
    put("submap_places", m.id, place);
  }

  void write_graph(const GraphState& g, const SessionChange& change) {
    const auto map_from_odom = encode_pose_with(g.map_from_odom, g.ended ? 1.0 : 0.0, g.revision);
    const auto keyposes = encode_poses(g.map_from_submap);
    sqlite::Statement(*db, "INSERT OR REPLACE INTO graph VALUES (0, ?, ?, ?, ?)")
        .bind(g.revision)
        .bind(std::int64_t{g.ended})
        .bind(map_from_odom)
        .bind(keyposes)
        .run();
    sqlite::Statement s(*db, "INSERT OR REPLACE INTO closures VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)");
    for (const std::size_t i : change.changed_closures) {
      const ClosureRecord& c = g.closures.at(i);
      const auto data = encode_closure(c);
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
    for (std::size_t i = change.new_edges_from; i < g.odometry.size(); ++i) {
      put("odometry_edges", static_cast<std::int64_t>(g.odometry[i].from), encode_edge(g.odometry[i]));
    }
    for (auto it = g.trajectory.begin(); it != g.trajectory.end();) {
      const auto end =
          std::find_if(it, g.trajectory.end(), [it](const auto& p) { return p.submap != it->submap; });
      if (it->submap >= change.moved_from) put("trajectory", it->submap, encode_final_poses({it, end}));
      it = end;
    }
  }

  // What follows from the rest; empty if any of it is missing or damaged.
  void read_derived(GraphState& g) const {
    if (version < kDerivedSince) return;
    for (std::size_t k = 0; k < g.map_from_submap.size(); ++k) {
      const auto id = static_cast<std::int64_t>(k);
      const auto poses = find("trajectory", id);
      if (poses) {
        const auto part = decode_final_poses(*poses, where("trajectory", id), id);
        g.trajectory.insert(g.trajectory.end(), part.begin(), part.end());
      }
      if (k + 1 == g.map_from_submap.size()) break;
      const auto edge = find("odometry_edges", id);
      if (!edge) break;  // of an older version
      g.odometry.push_back(decode_edge(*edge, where("odometry edge", id), k));
    }
  }

  void read_closures(GraphState& g, const std::function<void(const DamageError&)>& damaged) const {
    sqlite::Statement c(*db,
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
      try {
        decode_closure(c.bytes(8), where("closure", c.number(0)), r);
      } catch (const DamageError& e) {
        damaged(e);
        continue;
      }
      g.closures.push_back(r);
    }
  }

  static constexpr std::int64_t kDerivedSince = 4;
  std::optional<SessionLock> lock;
  std::unique_ptr<sqlite::Database> db;
  std::int64_t version = 0;
};

SessionStore::SessionStore(const std::string& folder, Access access, std::int64_t session_id)
    : impl_(std::make_unique<Impl>(folder, access, session_id)) {
  const std::int64_t stored = this->session_id();
  if (session_id == 0 || stored == session_id) return;
  throw Error("the stored session has another number, " + std::to_string(stored), impl_->db->path(),
              "Give its own with --session-id, or none.");
}
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
  m.odom_from_submap = decode_pose_with(s.bytes(2), where, m.travelled_m, m.scans_skipped);
  m.scans = decode_scans(impl_->blob("submap_scans", id), where);
  if (with_points) decode_points(impl_->blob("submap_points", id), where, m);
  return m;
}

Submap SessionStore::read_what_is_left(std::int64_t id, std::vector<std::string>& said) const {
  Submap m;
  m.id = id;
  const std::string where = impl_->where("submap", id), name = "submap " + std::to_string(id);
  const auto attempt = [&](const std::string& what, const auto& read) {
    try {
      read();
    } catch (const DamageError&) {
      said.push_back("the session is damaged: " + what + " of " + name + " cannot be read and is left out");
    }
  };
  attempt("the keypose", [&] {
    sqlite::Statement s(*impl_->db, "SELECT travelled_m, scans_skipped, keypose FROM submaps WHERE id = ?");
    s.bind(id);
    if (!s.step()) throw damage("a record is missing", where);
    m.odom_from_submap = decode_pose_with(s.bytes(2), where, m.travelled_m, m.scans_skipped);
  });
  attempt("what is known of the scans",
          [&] { m.scans = decode_scans(impl_->blob("submap_scans", id), where); });
  attempt("the part of the map", [&] { decode_points(impl_->blob("submap_points", id), where, m); });
  return m;
}

std::vector<std::uint8_t> SessionStore::read_place(std::int64_t id) const {
  // Of before version 3 they are laid out differently.
  const auto bytes = impl_->version < 3 ? std::nullopt : impl_->find("submap_places", id);
  return bytes ? *bytes : sqlite::Bytes();
}

void SessionStore::write_place(std::int64_t id, const std::vector<std::uint8_t>& place) {
  impl_->put("submap_places", id, place);
}

std::vector<std::uint8_t> SessionStore::read_frontend_state() const {
  sqlite::Statement s(*impl_->db, "SELECT state FROM frontend_state");
  if (!s.step()) return {};
  if (impl_->version < Impl::kDerivedSince) return s.bytes(0);
  return decode_frontend_state(s.bytes(0), impl_->db->path() + ", the front-end's state").first;
}

bool SessionStore::last_submap_stored() const {
  sqlite::Statement s(*impl_->db, "SELECT last FROM frontend_state");
  return s.step() && s.number(0) != 0;
}

bool SessionStore::results_written() const {
  sqlite::Statement s(*impl_->db, "SELECT revision, ended FROM graph");
  if (!s.step() || s.number(1) == 0) return false;
  if (impl_->version < Impl::kDerivedSince) return true;
  const auto meta = read_meta();
  const auto written = meta.find(kResultsWritten);
  return written != meta.end() && written->second == std::to_string(s.number(0));
}

GraphState SessionStore::read_graph(OnDamage on_damage, std::vector<std::string>* said) const {
  const auto damaged = [&](const DamageError& e) {
    if (on_damage == OnDamage::kThrow) throw;
    if (said != nullptr) said->push_back(e.what());
  };
  // One read transaction: a back-end that writes meanwhile cannot mix two revisions.
  sqlite::Transaction snapshot(*impl_->db, sqlite::Transaction::Kind::kRead);
  GraphState g;
  sqlite::Statement s(*impl_->db, "SELECT revision, ended, map_from_odom, map_from_submap FROM graph");
  if (!s.step()) return g;
  const std::string where = impl_->db->path() + ", graph";
  try {
    double ended = static_cast<double>(s.number(1));
    g.revision = s.number(0);
    g.map_from_odom = decode_pose_with(s.bytes(2), where, ended, g.revision);
    g.ended = ended != 0.0;
    g.map_from_submap = decode_poses(s.bytes(3), where);
    impl_->read_closures(g, damaged);
  } catch (const DamageError& e) {
    damaged(e);
  }
  try {
    impl_->read_derived(g);
  } catch (const DamageError& e) {
    g.trajectory.clear();
    g.odometry.clear();
    if (said != nullptr) said->push_back(std::string("computed again, as it was damaged: ") + e.what());
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
  if (change.graph) impl_->write_graph(*change.graph, change);
  if (change.frontend_state) {
    const auto state = encode_frontend_state(*change.frontend_state, change.last);
    sqlite::Statement(*impl_->db, "INSERT OR REPLACE INTO frontend_state VALUES (0, ?, ?)")
        .bind(state)
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
