// The disk fails, or the process is killed, at every single write and sync of a short session. The same again
// must lead to the undisturbed session, bit for bit.
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backend/backend.hpp"
#include "backend_fixtures.hpp"
#include "common/error.hpp"
#include "common/session/session_check.hpp"
#include "common/session/session_records.hpp"
#include "common/session/sqlite.hpp"
#include "failing_disk.hpp"

namespace hp2 {
namespace {

using testing::DiskFault;
using ::testing::HasSubstr;
using testing::TemporaryFolder;
using Access = SessionStore::Access;

const std::map<std::string, std::string> kMeta{{"drive", "a"}, {"configuration", "x: 1"}};

// A session as the process runs it, from wherever it stands to its end.
void run_session(const std::string& folder, const std::vector<Submap>& chain) {
  SessionStore store(folder);
  store.write_meta(kMeta);
  Backend backend({}, store);
  for (auto id = static_cast<std::size_t>(store.submap_count()); id < chain.size(); ++id) {
    backend.add_submap(chain[id], {static_cast<std::uint8_t>(id), 7}, id + 1 == chain.size());
  }
  backend.finish();
  store.write_meta({{kResultsWritten, std::to_string(backend.graph().revision)}});
}

void append(std::string& out, const void* p, std::size_t n) { out.append(static_cast<const char*>(p), n); }
void append(std::string& out, const Pose& pose) {
  append(out, pose.rotation.coeffs().data(), 32);
  append(out, pose.translation.data(), 24);
}

// All that a session amounts to, as bytes.
std::string contents(const std::string& folder) {
  const SessionStore store(folder, Access::kReadOnly);
  std::string out;
  const GraphState g = store.read_graph();
  append(out, &g.revision, 8);
  append(out, &g.ended, 1);
  for (const Pose& p : g.map_from_submap) append(out, p);
  for (const GraphEdge& e : g.odometry) {
    append(out, e.from_from_to);
    append(out, e.information.data(), 36 * 8);
  }
  for (const ClosureRecord& c : g.closures)
    out += c.reason + std::to_string(c.from_submap) + std::to_string(c.accepted);
  for (const TrajectoryPose& p : g.trajectory) {
    append(out, &p.sequence, 8);
    append(out, p.map_from_sensor);
    append(out, p.odom_from_sensor);
  }
  for (std::int64_t id = 0; id < store.submap_count(); ++id) {
    const Submap m = store.read_submap(id);
    append(out, m.points.data(), m.points.size() * 12);
    append(out, m.scan_indices.data(), m.scan_indices.size() * 4);
  }
  const auto state = store.read_frontend_state();
  return out + std::string(state.begin(), state.end());
}

// Runs `f` in a process of its own. @return its exit status, or 128 and the signal that ended it
int in_child(const std::function<int()>& f) {
  const pid_t child = fork();
  if (child == 0) _exit(f());
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

class SessionFaults : public ::testing::TestWithParam<DiskFault> {};

TEST_P(SessionFaults, AtEveryWriteAndSyncTheSameAgainGivesTheSameBits) {
  const auto chain = testing::random_chain(3, 200);
  TemporaryFolder plain;
  run_session(plain.path(), chain);
  const std::string expected = contents(plain.path());
  int faults = 0;
  for (std::int64_t at = 0;; ++at) {
    TemporaryFolder folder;
    const int status = in_child([&] {
      testing::use_failing_disk();
      testing::failing_disk() = {GetParam(), at, 0};
      int said = 0;
      try {
        run_session(folder.path(), chain);
      } catch (const Error& e) {
        said = std::strstr(e.what(), "disk") != nullptr || std::strstr(e.what(), "opened") != nullptr ? 1 : 2;
        if (said == 2) std::fprintf(stderr, "%s\n", e.what());
      }
      // Its last operations may fail at no loss: the WAL is kept when it cannot be taken in.
      return testing::failing_disk().operations <= at ? 77 : said;
    });
    if (status == 77) break;
    ++faults;
    ASSERT_TRUE(status == 0 || status == 1 || status == 128 + SIGKILL) << "status " << status << " at " << at;
    std::string may;
    try {
      may = check_session(folder.path(), kMeta);
    } catch (const Error& e) {
      may = e.what();
      ASSERT_THAT(may, HasSubstr("complete")) << "at " << at;
      ASSERT_EQ(contents(folder.path()), expected) << "at " << at;
      continue;
    }
    ASSERT_EQ(in_child([&] {
                run_session(folder.path(), chain);
                return 0;
              }),
              0)
        << "at " << at << " after: " << may;
    ASSERT_EQ(contents(folder.path()), expected) << "at " << at;
  }
  EXPECT_GT(faults, 30);
}

INSTANTIATE_TEST_SUITE_P(Disk, SessionFaults,
                         ::testing::Values(DiskFault::kInputOutput, DiskFault::kFull, DiskFault::kKill));

TEST(SessionFile, AnEmptyOrCutFileIsBegunAnew) {
  const auto chain = testing::random_chain(2, 100);
  TemporaryFolder plain;
  run_session(plain.path(), chain);
  const std::string expected = contents(plain.path());
  std::string whole(100000, '\0');
  {
    std::ifstream in(plain / "session.sqlite", std::ios::binary);
    in.read(whole.data(), static_cast<std::streamsize>(whole.size()));
  }
  for (const std::size_t bytes : {0, 10, 99}) {
    TemporaryFolder folder;
    std::ofstream(folder / "session.sqlite", std::ios::binary) << whole.substr(0, bytes);
    EXPECT_THAT(check_session(folder.path(), kMeta), HasSubstr("new session")) << bytes;
    run_session(folder.path(), chain);
    EXPECT_EQ(contents(folder.path()), expected) << bytes;
  }
  // As versions before 4 left it when they were killed early: a database without tables, its WAL cut.
  TemporaryFolder folder;
  {
    sqlite::Database db(folder / "session.sqlite", sqlite::Database::Mode::kReadWriteCreate);
    db.execute("PRAGMA page_size = 16384; PRAGMA journal_mode = WAL");
  }
  std::ofstream(folder / "session.sqlite-wal", std::ios::binary) << std::string(100, 'x');
  EXPECT_THAT(check_session(folder.path(), kMeta), HasSubstr("new session"));
  run_session(folder.path(), chain);
  EXPECT_EQ(contents(folder.path()), expected);
  // Somebody else's file stays.
  TemporaryFolder foreign;
  std::ofstream(foreign / "session.sqlite") << "a note";
  EXPECT_THROW(check_session(foreign.path(), kMeta), Error);
  EXPECT_THROW(SessionStore store(foreign.path()), Error);
}

TEST(SessionFile, ACutWalLosesSubmapsAndNoMore) {
  const auto chain = testing::random_chain(2, 100);
  TemporaryFolder plain, folder;
  run_session(plain.path(), chain);
  ASSERT_EQ(in_child([&] {
              SessionStore store(folder.path());
              Backend backend({}, store);
              backend.add_submap(chain[0], {1}, false);
              _exit(0);  // as killed: the WAL stays
              return 1;
            }),
            0);
  ASSERT_EQ(truncate((folder / "session.sqlite-wal").c_str(), 100), 0);
  EXPECT_THAT(check_session(folder.path(), kMeta), HasSubstr("new session"));
  run_session(folder.path(), chain);
  EXPECT_EQ(contents(folder.path()), contents(plain.path()));
}

// Flips one bit in the middle of a blob.
void flip(const std::string& file, const std::string& table, const std::string& column) {
  sqlite::Database db(file, sqlite::Database::Mode::kReadWrite);
  sqlite::Bytes bytes;
  {
    sqlite::Statement s(db, "SELECT " + column + " FROM " + table);
    ASSERT_TRUE(s.step()) << table;
    bytes = s.bytes(0);
  }
  ASSERT_GT(bytes.size(), 1U) << table;
  bytes[bytes.size() / 2] ^= 4;
  const std::string key = table == "closures" ? "number" : "id";
  sqlite::Statement(db, "UPDATE " + table + " SET " + column + " = ? WHERE " + key + " = 0")
      .bind(bytes)
      .run();
}

TEST(SessionDamage, AFlippedBitInAnyBlobIsNoticedAndWhatFollowsIsComputedAgain) {
  const auto chain = testing::random_chain(3, 200);
  TemporaryFolder plain;
  run_session(plain.path(), chain);
  const std::string expected = contents(plain.path());
  const std::vector<std::pair<std::string, std::string>> refused{
      {"submaps", "keypose"},     {"submap_scans", "data"},     {"submap_points", "data"},
      {"graph", "map_from_odom"}, {"graph", "map_from_submap"}, {"frontend_state", "state"}},
      made_again{{"submap_places", "data"}, {"trajectory", "data"}, {"odometry_edges", "data"}};
  for (const auto& [table, column] : refused) {
    TemporaryFolder folder;
    run_session(folder.path(), chain);
    flip(folder / "session.sqlite", table, column);
    try {
      contents(folder.path());
      ADD_FAILURE() << table << " is read as if nothing were";
    } catch (const Error& e) {
      EXPECT_THAT(e.what(), HasSubstr("damaged")) << table;
    }
  }
  for (const auto& [table, column] : made_again) {
    TemporaryFolder folder;
    run_session(folder.path(), chain);
    flip(folder / "session.sqlite", table, column);
    {
      SessionStore store(folder.path());
      const Backend backend({}, store);
    }
    EXPECT_EQ(contents(folder.path()), expected) << table;
  }
}

TEST(SessionDamage, OfADamagedSubmapTheRestIsLeft) {
  const auto chain = testing::random_chain(3, 200);
  TemporaryFolder folder;
  run_session(folder.path(), chain);
  flip(folder / "session.sqlite", "submap_points", "data");
  const SessionStore store(folder.path(), Access::kReadOnly);
  std::vector<std::string> said;
  const Submap m = store.read_what_is_left(0, said);
  ASSERT_EQ(said.size(), 1U);
  EXPECT_THAT(said[0], HasSubstr("submap 0"));
  EXPECT_TRUE(m.points.empty());
  EXPECT_EQ(m.scans.size(), chain[0].scans.size());
  said.clear();
  EXPECT_EQ(store.read_what_is_left(1, said).points, chain[1].points);
  EXPECT_TRUE(said.empty());
}

// The checksum of versions 1 and 2: FNV-1a, byte by byte.
void give_old_checksum(sqlite::Bytes& bytes) {
  ASSERT_GE(bytes.size(), 8U);
  std::uint64_t h = 1469598103934665603ULL;
  for (std::size_t i = 0; i + 8 < bytes.size(); ++i) h = (h ^ bytes[i]) * 1099511628211ULL;
  std::memcpy(bytes.data() + bytes.size() - 8, &h, 8);
}

// Gives every blob of a column the checksum of versions 1 and 2. `spoil`: and other contents.
void make_old(sqlite::Database& db, const std::string& table, const std::string& column, bool spoil = false) {
  const std::string key = table == "closures" ? "number" : "id";
  std::map<std::int64_t, sqlite::Bytes> rows;
  {
    sqlite::Statement s(db, "SELECT " + key + ", " + column + " FROM " + table);
    while (s.step()) rows[s.number(0)] = s.bytes(1);
  }
  for (auto& [id, bytes] : rows) {
    if (spoil) bytes.assign(100, 3);
    give_old_checksum(bytes);
    sqlite::Statement(db, "UPDATE " + table + " SET " + column + " = ? WHERE " + key + " = ?")
        .bind(bytes)
        .bind(id)
        .run();
  }
}

class OldSession : public ::testing::TestWithParam<int> {};

// What versions before 4 stored: nothing that follows from the submaps, the front-end's state as it came.
// Before version 3 other checksums and other places.
TEST_P(OldSession, IsReadAndGoneOnWith) {
  const auto chain = testing::random_chain(4, 200);
  TemporaryFolder plain, folder;
  run_session(plain.path(), chain);
  const std::string expected = contents(plain.path());
  {
    SessionStore store(folder.path());
    store.write_meta(kMeta);
    Backend backend({}, store);
    for (int id = 0; id < 2; ++id) backend.add_submap(chain[id], {static_cast<std::uint8_t>(id), 7}, false);
  }
  {
    sqlite::Database db(folder / "session.sqlite", sqlite::Database::Mode::kReadWrite);
    const sqlite::Bytes state{1, 7};
    db.execute("DROP TABLE trajectory; DROP TABLE odometry_edges; PRAGMA user_version = " +
               std::to_string(GetParam()));
    if (GetParam() < 3) {
      make_old(db, "submaps", "keypose");
      for (const char* table : {"submap_scans", "submap_points"}) make_old(db, table, "data");
      make_old(db, "submap_places", "data", true);
      make_old(db, "closures", "constraint_data");
      for (const char* column : {"map_from_odom", "map_from_submap"}) make_old(db, "graph", column);
    }
    sqlite::Statement(db, "UPDATE frontend_state SET state = ?").bind(state).run();
  }
  {
    const SessionStore store(folder.path(), Access::kReadOnly);
    EXPECT_EQ(store.read_graph().map_from_submap.size(), 2U);
    EXPECT_EQ(store.read_frontend_state(), (std::vector<std::uint8_t>{1, 7}));
    EXPECT_EQ(store.read_submap(1).points, chain[1].points);
  }
  EXPECT_THAT(check_session(folder.path(), kMeta), HasSubstr("going on"));
  run_session(folder.path(), chain);
  EXPECT_EQ(contents(folder.path()), expected);
}

INSTANTIATE_TEST_SUITE_P(Versions, OldSession, ::testing::Values(1, 2, 3));

}  // namespace
}  // namespace hp2
