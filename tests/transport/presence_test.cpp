#include "common/transport/presence.hpp"

#include <limits>

#include <gtest/gtest.h>

#include "common/transport/channels.hpp"
#include "common/transport/peer_summary.hpp"
#include "common/transport/process.hpp"
#include "tests/transport/fake_bus.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kSession = 77;
constexpr std::int64_t kStepUs = 10'000;

struct Listener {
  explicit Listener(FakeNetwork& network) : bus(network), endpoint(bus), presence(endpoint, "listener") {
    endpoint.set_session(kSession);
  }
  FakeBus bus;
  Endpoint endpoint;
  Presence presence;
};

status_t made_up_status(std::int64_t sender, const std::string& process, std::int64_t session = kSession) {
  status_t m{};
  m.sender_id = sender;
  m.session_id = session;
  m.process = process;
  m.state = status_t::RUNNING;
  return m;
}

TEST(Presence, AFloodDrivesOutNoProcessOfTheSession) {
  FakeNetwork network;
  Listener listener(network);
  FakeBus others(network);
  Endpoint sender(others);
  const auto say = [&](const status_t& m) {
    sender.publish(kStatusChannel, m);
    network.step(kStepUs);
  };
  for (int i = 0; i < 3; ++i) say(made_up_status(1, "hp2_frontend"));
  for (int i = 0; i < 2000; ++i) {
    say(made_up_status(1000 + i, "flood", i % 2 == 0 ? kSession : 5 + i));
    if (i % 50 == 0) say(made_up_status(1, "hp2_frontend"));
    ASSERT_NE(listener.presence.live("hp2_frontend"), nullptr) << "after " << i;
  }
  EXPECT_LE(listener.presence.peers().size(), 64U);
  auto ended = made_up_status(1, "hp2_frontend");
  ended.state = status_t::FINISHED;
  say(ended);
  EXPECT_EQ(listener.presence.live("hp2_frontend"), nullptr);
}

TEST(Presence, EachRemarkIsHeardAtOnce) {
  FakeNetwork network;
  Listener listener(network), player(network);
  const auto polls = [&] {
    player.presence.poll();
    network.step(kStepUs);
  };
  for (const char* remark : {"scan 3 is damaged", "scan 4 is damaged"}) player.presence.warn(remark);
  polls();
  polls();
  EXPECT_EQ(listener.presence.warnings().size(), 2U);
  const std::int64_t number = player.presence.number();
  polls();
  EXPECT_EQ(player.presence.number(), number) << "nothing new is said";
}

TEST(Presence, WhoIsSilentIsMissedUnlessItEndedOrIsDead) {
  FakeNetwork network;
  Listener listener(network);
  FakeBus others(network);
  Endpoint sender(others);
  const auto far_away = made_up_status(1, "hp2_frontend");
  auto alive = made_up_status(2, "hp2_frontend"), dead = made_up_status(3, "hp2_frontend"),
       ended = made_up_status(4, "hp2_frontend");
  alive.host = dead.host = listener.presence.status().host;
  alive.pid = listener.presence.status().pid;
  dead.pid = std::numeric_limits<std::int32_t>::max();  // more than any system gives
  ended.state = status_t::FINISHED;
  for (const auto& m : {far_away, alive, dead, ended}) sender.publish(kStatusChannel, m);
  sender.publish(kStatusChannel, made_up_status(5, "hp2_frontend", kSession + 1));
  network.step(kStepUs);
  const auto missed = [&] {
    std::vector<std::int64_t> ids;
    for (const Peer* p : listener.presence.all_missed("hp2_frontend")) ids.push_back(p->status.sender_id);
    return ids;
  };
  EXPECT_EQ(missed(), (std::vector<std::int64_t>{1, 2, 3}));
  network.step(20'000'000);
  EXPECT_TRUE(listener.presence.all_live("hp2_frontend").empty());
  EXPECT_EQ(missed(), (std::vector<std::int64_t>{1, 2}));
  EXPECT_TRUE(listener.presence.missed(1));
  EXPECT_FALSE(listener.presence.missed(3));
  EXPECT_FALSE(listener.presence.missed(4));
  EXPECT_TRUE(listener.presence.missed(99)) << "its STATUS may still come";
  network.step(20'000'000);
  EXPECT_TRUE(missed().empty());
}

TEST(Presence, WhatOthersSayOfThemselvesHarmsNeitherTerminalNorSummary) {
  FakeNetwork network;
  Listener listener(network);
  FakeBus others(network);
  Endpoint sender(others);
  auto status = made_up_status(9, "\xff\x1b[2J");
  status.text = "warning: \xc3(\n\x07";
  sender.publish(kStatusChannel, status);
  network.step(kStepUs);
  ASSERT_EQ(listener.presence.peers().count(9), 1U);
  EXPECT_EQ(listener.presence.peers().at(9).status.process, "??[2J");
  const auto text = as_text(peers_as_json(listener.presence)) + as_text(warnings_as_json(listener.presence));
  EXPECT_EQ(text.find('\xff'), std::string::npos);
  EXPECT_TRUE(nlohmann::json::accept(as_text(peers_as_json(listener.presence))));
  EXPECT_EQ(listener.presence.warnings().size(), 1U);
}

TEST(Control, OnlyCommandsOfThisSessionForThisProcessAreObeyed) {
  FakeNetwork network;
  Listener listener(network);
  std::vector<std::pair<int, bool>> heard;
  const ControlListener control(listener.endpoint, "listener", [&](const control_t& m, bool named) {
    heard.emplace_back(m.command, named);
  });
  FakeBus others(network);
  Endpoint sender(others);
  const auto say = [&](std::int64_t session, const std::string& target, int command) {
    control_t m{};
    m.session_id = session;
    m.target = target;
    m.command = static_cast<std::int8_t>(command);
    sender.publish(kControlChannel, m);
    network.step(kStepUs);
  };
  say(0, "", control_t::STOP);
  say(kSession + 1, "", control_t::STOP);
  say(kSession + 1, "listener", control_t::STOP);
  say(kSession, "somebody else", control_t::STOP);
  say(kSession, "", 0);
  say(kSession, "", 99);
  EXPECT_TRUE(heard.empty());
  say(kSession, "", control_t::STOP);
  say(kSession, "listener", control_t::PAUSE);
  EXPECT_EQ(heard, (std::vector<std::pair<int, bool>>{{control_t::STOP, false}, {control_t::PAUSE, true}}));
}

}  // namespace
}  // namespace hp2
