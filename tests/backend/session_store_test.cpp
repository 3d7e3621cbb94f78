#include "common/session/session_store.hpp"

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <random>
#include <sys/wait.h>
#include <unistd.h>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backend/backend.hpp"
#include "backend_fixtures.hpp"
#include "common/error.hpp"
#include "common/session/session_check.hpp"
#include "common/session/sqlite.hpp"
#include "common/session/submap_codec.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;
using testing::random_chain;
using testing::TemporaryFolder;
using Access = SessionStore::Access;

std::string integrity(const std::string& file) {
  sqlite::Database db(file, sqlite::Database::Mode::kReadOnly);
  return db.text("PRAGMA integrity_check");
}

template <class F>
std::string error_of(F&& f) {
  try {
    f();
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

void store_all(Backend& backend, const std::vector<Submap>& chain, bool last = false) {
  for (const Submap& m : chain) {
    backend.add_submap(m, {1, 2, static_cast<std::uint8_t>(m.id)}, last && &m == &chain.back());
  }
}

TEST(SessionStore, GivesBackWhatWasStored) {
  TemporaryFolder folder;
  const auto chain = random_chain(3);
  std::int64_t id = 0;
  {
    SessionStore store(folder.path());
    id = store.session_id();
    EXPECT_GT(id, 0);
    Backend backend({}, store);
    store_all(backend, chain, true);
    store.write_meta({{"data", "somewhere"}, {"configuration", "a: 1\n"}});
    store.write_meta({{"data", "elsewhere"}});
  }
  for (const auto access : {Access::kReadWrite, Access::kReadOnly}) {
    const SessionStore store(folder.path(), access);
    EXPECT_EQ(store.session_id(), id);
    ASSERT_EQ(store.submap_count(), 3);
    EXPECT_TRUE(store.last_submap_stored());
    EXPECT_EQ(store.read_frontend_state(), (std::vector<std::uint8_t>{1, 2, 2}));
    EXPECT_EQ(store.read_meta().at("data"), "elsewhere");
    EXPECT_EQ(store.read_meta().at("configuration"), "a: 1\n");
    for (const Submap& m : chain) {
      const Submap r = store.read_submap(m.id);
      EXPECT_EQ(r.points, m.points);
      EXPECT_EQ(r.scan_indices, m.scan_indices);
      ASSERT_EQ(r.normals.size(), m.normals.size());
      for (std::size_t i = 0; i < m.normals.size(); ++i) {
        EXPECT_LT((r.normals[i] - m.normals[i]).norm(), 0.01F);
        EXPECT_EQ(r.normals[i].isZero(), m.normals[i].isZero());
      }
      EXPECT_EQ(r.travelled_m, m.travelled_m);
      EXPECT_EQ(r.odom_from_submap.matrix(), m.odom_from_submap.matrix());
      ASSERT_EQ(r.scans.size(), m.scans.size());
      for (std::size_t i = 0; i < m.scans.size(); ++i) {
        EXPECT_EQ(r.scans[i].sequence, m.scans[i].sequence);
        EXPECT_EQ(r.scans[i].utime, m.scans[i].utime);
        EXPECT_EQ(r.scans[i].submap_from_sensor.translation, m.scans[i].submap_from_sensor.translation);
        EXPECT_EQ(r.scans[i].covariance, m.scans[i].covariance);
        EXPECT_EQ(r.scans[i].state, m.scans[i].state);
        EXPECT_EQ(r.scans[i].diagnostics.ms, m.scans[i].diagnostics.ms);
      }
    }
  }
}

// A back-end that was started again reads from disk what the other one got from the network.
TEST(SessionStore, NormalsAreTheSameBitsFromTheNetworkAndFromDisk) {
  Submap made = random_chain(1)[0];
  std::mt19937 rng(4);
  std::normal_distribution<float> normal;
  for (auto& n : made.normals) n = Eigen::Vector3f(normal(rng), normal(rng), normal(rng)).normalized();
  ASSERT_GT(made.normals.size(), 50U);
  Submap received, stored;
  decode_points(encode_points(made), "as from the network", received);
  decode_points(encode_points(received), "from disk", stored);
  EXPECT_EQ(received.normals, stored.normals);
  EXPECT_EQ(encode_points(received), encode_points(stored));
  for (std::size_t i = 0; i < made.normals.size(); ++i) {
    EXPECT_LT((received.normals[i] - made.normals[i]).cwiseAbs().maxCoeff(), 0.51F / 127.0F);
  }
}

TEST(SessionStore, ResumedBackendEqualsTheUninterruptedOne) {
  TemporaryFolder one, two;
  const auto chain = random_chain(6);
  SessionStore whole(one.path());
  Backend uninterrupted({}, whole);
  store_all(uninterrupted, chain);
  for (const Submap& m : chain) {
    SessionStore store(two.path());
    Backend backend({}, store);
    store_all(backend, {m});
  }
  const GraphState& a = uninterrupted.graph();
  const GraphState b = SessionStore(two.path(), Access::kReadOnly).read_graph();
  EXPECT_EQ(a.revision, b.revision);
  ASSERT_EQ(b.map_from_submap.size(), 6U);
  ASSERT_EQ(a.trajectory.size(), b.trajectory.size());
  ASSERT_EQ(b.trajectory.size(), 60U);
  for (std::size_t i = 0; i < a.trajectory.size(); ++i) {
    EXPECT_EQ(b.trajectory[i].sequence, static_cast<std::int64_t>(i));
    EXPECT_EQ(a.trajectory[i].map_from_sensor.translation, b.trajectory[i].map_from_sensor.translation);
    EXPECT_EQ(a.trajectory[i].map_from_sensor.rotation.coeffs(),
              b.trajectory[i].map_from_sensor.rotation.coeffs());
  }
}

TEST(SessionStore, ASubmapSentTwiceIsStoredOnce) {
  TemporaryFolder folder;
  const auto chain = random_chain(2);
  SessionStore store(folder.path());
  Backend backend({}, store);
  store_all(backend, chain);
  store_all(backend, chain);
  EXPECT_EQ(store.submap_count(), 2);
  EXPECT_EQ(backend.graph().trajectory.size(), 20U);
  EXPECT_EQ(backend.graph().revision, 2);
}

TEST(SessionStore, ASubmapOutOfOrderIsRefusedAndChangesNothing) {
  TemporaryFolder folder;
  const auto chain = random_chain(3);
  SessionStore store(folder.path());
  Backend backend({}, store);
  store_all(backend, {chain[0]});
  EXPECT_THAT(error_of([&] { store_all(backend, {chain[2]}); }), HasSubstr("Send submap 1 first"));
  EXPECT_EQ(store.submap_count(), 1);
}

// A child stores submaps without end and is killed at a random moment, in the middle of a transaction more
// often than not.
TEST(SessionStore, KilledAtAnyMomentTheSessionIsWholeUpToTheLastCommit) {
  const auto chain = random_chain(40, 20000);
  std::mt19937 rng(7);
  for (int round = 0; round < 8; ++round) {
    TemporaryFolder folder;
    int committed[2];
    ASSERT_EQ(pipe(committed), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      close(committed[0]);
      SessionStore store(folder.path());
      Backend backend({}, store);
      for (const Submap& m : chain) {
        backend.add_submap(m, {static_cast<std::uint8_t>(m.id)}, false);
        if (write(committed[1], "x", 1) != 1) _exit(1);
      }
      pause();
    }
    close(committed[1]);
    char c = 0;
    const int wanted = 1 + static_cast<int>(rng() % 8);
    int told = 0;
    while (told < wanted && read(committed[0], &c, 1) == 1) ++told;
    usleep(static_cast<useconds_t>(rng() % 20000));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    while (read(committed[0], &c, 1) == 1) ++told;
    close(committed[0]);

    ASSERT_GE(told, wanted);
    EXPECT_EQ(integrity(folder / "session.sqlite"), "ok");
    SessionStore store(folder.path());
    ASSERT_GE(store.submap_count(), told);
    EXPECT_LE(store.submap_count(), told + 1);
    EXPECT_EQ(store.read_frontend_state().at(0), static_cast<std::uint8_t>(store.submap_count() - 1));
    for (std::int64_t id = 0; id < store.submap_count(); ++id)
      EXPECT_EQ(store.read_submap(id).points, chain[id].points);
    Backend backend({}, store);
    ASSERT_EQ(backend.graph().map_from_submap.size(), static_cast<std::size_t>(store.submap_count()));
    backend.add_submap(chain[store.submap_count()], {}, false);
  }
}

TEST(SessionStore, ASecondBackEndOnTheSameSessionIsRefused) {
  TemporaryFolder folder;
  const SessionStore first(folder.path());
  EXPECT_THAT(error_of([&] { SessionStore second(folder.path()); }), HasSubstr("in use by another back-end"));
  EXPECT_THAT(error_of([&] { check_session(folder.path(), {}); }), HasSubstr("in use by another back-end"));
  EXPECT_EQ(error_of([&] { SessionStore reader(folder.path(), Access::kReadOnly); }), "");
}

TEST(SessionCheck, SaysWhatARunMayDoInAFolder) {
  TemporaryFolder folder;
  EXPECT_THAT(check_session(folder.path(), {{"drive", "a"}}), HasSubstr("new session"));
  EXPECT_FALSE(std::ifstream(folder / "session.sqlite").good()) << "asking has made one";
  const auto chain = random_chain(3);
  {
    SessionStore store(folder.path());
    store.write_meta({{"drive", "a"}, {"configuration", "x: 1"}});
    Backend backend({}, store);
    EXPECT_THAT(error_of([&] { check_session(folder.path(), {{"drive", "b"}}); }), HasSubstr("in use"));
  }
  EXPECT_THAT(check_session(folder.path(), {{"drive", "b"}}), HasSubstr("new session"))
      << "nothing is stored yet";
  {
    SessionStore store(folder.path());
    Backend backend({}, store);
    store_all(backend, {chain[0], chain[1]});
  }
  const std::map<std::string, std::string> same{
      {"drive", "a"}, {"configuration", "x: 1"}, {"started", "now"}};
  EXPECT_THAT(check_session(folder.path(), same), HasSubstr("going on"));
  EXPECT_THAT(check_session(folder.path(), same), HasSubstr("20 scans in 2 submaps"));
  EXPECT_THAT(error_of([&] {
                check_session(folder.path(), {{"drive", "b"}});
              }),
              HasSubstr("another drive: a, not b"));
  EXPECT_THAT(error_of([&] {
                check_session(folder.path(), {{"configuration", "x: 2"}});
              }),
              HasSubstr("other settings"));
  {
    SessionStore store(folder.path());
    Backend backend({}, store);
    store_all(backend, {chain[2]}, true);
  }
  EXPECT_THAT(check_session(folder.path(), same), HasSubstr("not refined yet"));
  {
    SessionStore store(folder.path());
    Backend backend({}, store);
    backend.finish();
  }
  EXPECT_THAT(check_session(folder.path(), same), HasSubstr("results are not written yet"));
  {
    SessionStore store(folder.path());
    store.write_meta({{kResultsWritten, std::to_string(store.read_graph().revision)}});
  }
  EXPECT_THAT(error_of([&] { check_session(folder.path(), same); }),
              HasSubstr("complete: 30 scans in 3 submaps of a"));
}

TEST(SessionStore, AFullDiskIsSaidAndNothingStoredIsLost) {
  TemporaryFolder folder;
  const auto chain = random_chain(20, 20000);
  SessionStore store(folder.path());
  store.limit_size(4 << 20);
  Backend backend({}, store);
  const std::string said = error_of([&] { store_all(backend, chain); });
  EXPECT_THAT(said, HasSubstr("full"));
  const std::int64_t n = store.submap_count();
  ASSERT_GT(n, 2);
  ASSERT_LT(n, 20);
  EXPECT_EQ(backend.graph().map_from_submap.size(), static_cast<std::size_t>(n));
  EXPECT_EQ(store.read_submap(n - 1).points, chain[n - 1].points);
  EXPECT_EQ(integrity(folder / "session.sqlite"), "ok");
  // Space is made: the same submap is sent again and all goes on.
  store.limit_size(0);
  store_all(backend, chain);
  EXPECT_EQ(store.submap_count(), 20);
}

TEST(SessionStore, AFolderThatCannotBeMadeIsSaid) {
  EXPECT_THAT(error_of([] { SessionStore("/proc/nowhere/session"); }), HasSubstr("folder cannot be made"));
  TemporaryFolder folder;
  std::ofstream(folder.path() + "/file") << "x";
  EXPECT_THAT(error_of([&] { SessionStore(folder.path() + "/file"); }), HasSubstr("session"));
  EXPECT_THAT(error_of([&] { SessionStore(folder.path() + "/none", Access::kReadOnly); }),
              HasSubstr("no session"));
}

// Runs `f` as a user who may only read; root could write everywhere.
int as_another_user(const std::function<int()>& f) {
  const pid_t child = fork();
  if (child == 0) {
    if (geteuid() == 0 && (setgid(65534) != 0 || setuid(65534) != 0)) _exit(99);
    _exit(f());
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

TEST(SessionStore, AReadOnlyFolderIsReadAndWritingToItIsRefusedWithAMessage) {
  namespace fs = std::filesystem;
  TemporaryFolder folder;
  {
    SessionStore store(folder.path());
    Backend backend({}, store);
    store_all(backend, random_chain(2));
  }
  fs::permissions(folder / "session.sqlite",
                  fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read);
  fs::permissions(folder.path(), fs::perms::owner_read | fs::perms::owner_exec | fs::perms::others_read |
                                     fs::perms::others_exec);
  const std::string path = folder.path();
  EXPECT_EQ(
      as_another_user([&] {
        return error_of([&] { SessionStore store(path); }).find("cannot be written") != std::string::npos ? 7
                                                                                                          : 8;
      }),
      7);
  EXPECT_EQ(as_another_user([&] {
              try {
                return static_cast<int>(SessionStore(path, Access::kReadOnly).read_graph().trajectory.size());
              } catch (const Error& e) {
                fprintf(stderr, "%s\n", e.what());
                return 98;
              }
            }),
            20);
}

TEST(SessionStore, ADamagedFileIsSaidWhereverTheDamageIs) {
  TemporaryFolder folder;
  {
    SessionStore store(folder.path());
    Backend backend({}, store);
    store_all(backend, random_chain(3, 5000));
  }
  std::string whole;
  {
    std::ifstream in(folder / "session.sqlite", std::ios::binary);
    whole.assign(std::istreambuf_iterator<char>(in), {});
  }
  std::mt19937 rng(3);
  int refused = 0;
  for (int round = 0; round < 40; ++round) {
    std::string bad = whole;
    const std::size_t at = round == 0 ? 0 : rng() % bad.size();
    const std::size_t n = std::min<std::size_t>(bad.size() - at, 600);
    for (std::size_t i = 0; i < n; ++i) bad[at + i] = static_cast<char>(rng());
    if (round == 1) bad = whole.substr(0, whole.size() / 2);
    if (round == 2)
      bad = "not a database at all, but long enough to be looked at by SQLite: " + std::string(2000, 'x');
    std::ofstream(folder / "session.sqlite", std::ios::binary | std::ios::trunc) << bad;
    // Either it is refused with a message or what is read is what was stored: never a crash, never other
    // points.
    const std::string said = error_of([&] {
      SessionStore store(folder.path());
      for (std::int64_t id = 0; id < store.submap_count(); ++id) {
        EXPECT_EQ(store.read_submap(id).points, random_chain(3, 5000)[id].points);
      }
      store.read_graph();
    });
    refused += !said.empty();
    if (round < 3) {
      EXPECT_FALSE(said.empty()) << "round " << round;
    }
  }
  EXPECT_GT(refused, 15);  // the rest hit unused bytes
}

TEST(SessionStore, AnotherVersionAndAnotherProgramsFileAreRefused) {
  TemporaryFolder folder;
  { SessionStore store(folder.path()); }
  {
    sqlite::Database db(folder / "session.sqlite", sqlite::Database::Mode::kReadWriteCreate);
    db.execute("PRAGMA user_version = 99");
  }
  EXPECT_THAT(error_of([&] { SessionStore store(folder.path()); }), HasSubstr("version 99"));
  EXPECT_THAT(error_of([&] { SessionStore store(folder.path(), Access::kReadOnly); }),
              HasSubstr("version 99"));
  {
    sqlite::Database db(folder / "session.sqlite", sqlite::Database::Mode::kReadWriteCreate);
    db.execute("PRAGMA application_id = 1");
  }
  EXPECT_THAT(error_of([&] { SessionStore store(folder.path()); }), HasSubstr("no session of this program"));
}

}  // namespace
}  // namespace hp2
