// One message of a stranger, or in somebody's name, ends, starves and hangs nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/error.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/inbox.hpp"
#include "common/transport/outbox.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/stagnation.hpp"
#include "tests/transport/fake_bus.hpp"

namespace hp2 {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kSession = 77, kHuge = std::int64_t{1} << 50;

struct Party {
  explicit Party(FakeNetwork& network, std::int64_t session = kSession) : bus(network), endpoint(bus) {
    endpoint.set_session(session);
  }
  FakeBus bus;
  Endpoint endpoint;
};

struct Owner : Party {
  explicit Owner(FakeNetwork& network, const std::string& topic = "T")
      : Party(network), outbox(endpoint, topic, [](std::int64_t) {
          return std::make_shared<EncodedMessage>(ByteVector(100, std::uint8_t{7}));
        }) {}
  Outbox outbox;
};

struct Reader : Party {
  explicit Reader(FakeNetwork& network, Inbox::Order order = Inbox::Order::kAll)
      : Party(network), inbox(endpoint, {"T", order}, [this](const Delivery& d) { ids.push_back(d.id); }) {}
  Inbox inbox;
  std::vector<std::int64_t> ids;
};

template <class... Parties>
void run(FakeNetwork& network, int ms, Parties&... parties) {
  for (int i = 0; i < ms; ++i) {
    (parties.endpoint.poll(), ...);
    network.step(1000);
  }
}

fetch_t fetch_of(const Owner& owner, std::int64_t sender, std::int64_t done) {
  fetch_t m{};
  m.session_id = kSession;
  m.sender_id = sender;
  m.target_id = owner.endpoint.sender_id();
  m.topic = "T";
  m.done_id = m.wanted_id = done;
  return m;
}

TEST(ForeignMessages, NobodyIsDoneWithWhatWasNotSent) {
  FakeNetwork network;
  Owner owner(network);
  Reader reader(network);
  owner.outbox.offer(0, 1000, true);
  reader.inbox.set_limit(5);
  run(network, 500, owner, reader);
  reader.inbox.acknowledge(5, 5);
  run(network, 200, owner, reader);
  ASSERT_EQ(owner.outbox.done_id(), 5);
  for (const std::int64_t done : {fetch_t::ALL, kHuge}) {
    for (const std::int64_t sender : {std::int64_t{4711}, reader.endpoint.sender_id()}) {
      reader.endpoint.publish(kFetchChannel, fetch_of(owner, sender, done));
      run(network, 2000, owner, reader);
      EXPECT_FALSE(owner.outbox.over());
      EXPECT_EQ(owner.outbox.done_id(), 5);
      EXPECT_EQ(owner.outbox.wanted_id(), 5);
    }
  }
}

TEST(ForeignMessages, WhatAPredecessorSentIsBelievedWhenItIsRepeated) {
  FakeNetwork network;
  Owner owner(network);
  Reader reader(network);
  owner.outbox.offer(0, 1000, true);
  reader.inbox.set_limit(0);
  reader.inbox.acknowledge(500, 400);
  run(network, 100, owner, reader);
  EXPECT_EQ(owner.outbox.done_id(), 0);
  EXPECT_TRUE(owner.outbox.wish_pending());
  run(network, 1000, owner, reader);
  EXPECT_EQ(owner.outbox.done_id(), 400);
  EXPECT_EQ(owner.outbox.wanted_id(), 500);
  reader.inbox.acknowledge(1000, fetch_t::ALL);
  run(network, 1000, owner, reader);
  EXPECT_TRUE(owner.outbox.over());
}

offer_t offer_of(const Owner& owner, std::int64_t next, bool ended) {
  offer_t m{};
  m.session_id = kSession;
  m.sender_id = owner.endpoint.sender_id();
  m.topic = "T";
  m.next_id = next;
  m.ended = ended ? 1 : 0;
  return m;
}

TEST(ForeignMessages, ARevisionThatDoesNotExistIsNotWaitedFor) {
  FakeNetwork network;
  Owner owner(network);
  Reader reader(network, Inbox::Order::kLatest);
  owner.outbox.offer(3, 4, false);
  run(network, 500, owner, reader);
  reader.endpoint.publish(kOfferChannel, offer_of(owner, 1, false));
  Party stranger(network);
  stranger.endpoint.publish(kOfferChannel, offer_of(owner, kHuge, true));
  run(network, 1000, owner, reader);
  owner.outbox.offer(4, 5, false);
  run(network, 1000, owner, reader);
  ASSERT_FALSE(reader.ids.empty());
  EXPECT_EQ(reader.ids.back(), 4);
}

TEST(ForeignMessages, OneOfferInTheOwnersNameEndsNothing) {
  FakeNetwork network;
  Owner owner(network);
  Reader reader(network);
  Party stranger(network);
  owner.outbox.offer(0, 100, false);
  reader.inbox.set_limit(3);
  run(network, 300, owner, reader);
  stranger.endpoint.publish(kOfferChannel, offer_of(owner, 3, true));
  for (int i = 0; i < 500; ++i) {
    run(network, 1, owner, reader);
    ASSERT_FALSE(reader.inbox.ended()) << i;
  }
  owner.outbox.offer(0, 100, true);
  run(network, 1000, owner, reader);
  EXPECT_TRUE(reader.inbox.ended());
}

TEST(ForeignMessages, OneStatusEstablishesNobody) {
  FakeNetwork network;
  Party listener(network);
  Presence presence(listener.endpoint, "listener");
  Party stranger(network);
  status_t m{};
  m.sender_id = 1;
  m.session_id = kSession;
  m.process = "hp2_frontend";
  m.state = status_t::RUNNING;
  stranger.endpoint.publish(kStatusChannel, m);
  stranger.endpoint.publish(kStatusChannel, m);
  run(network, 10, listener);
  ASSERT_NE(presence.live("hp2_frontend"), nullptr);
  EXPECT_FALSE(presence.live("hp2_frontend")->established());
  run(network, 5000, listener);
  stranger.endpoint.publish(kStatusChannel, m);
  run(network, 500, listener);
  EXPECT_EQ(presence.peers().at(1).established(), false) << "two that lie seconds apart";
  stranger.endpoint.publish(kStatusChannel, m);
  run(network, 10, listener);
  EXPECT_TRUE(presence.live("hp2_frontend")->established());
}

TEST(ForeignMessages, ASessionThatIsGoneBeforeItWasTakenUpIsLeftForAnother) {
  FakeNetwork network;
  Party process(network, 0);
  process.endpoint.adopt_session_from({"T"});
  bool begun = false;
  process.endpoint.leave_silent_session([&] { return !begun; });
  offer_t m{};
  m.sender_id = 5;
  m.session_id = 1;
  m.topic = "T";
  Party other(network);
  other.endpoint.publish(kOfferChannel, m);
  run(network, 1000, process);
  ASSERT_EQ(process.endpoint.session_id(), 1);
  m.session_id = 2;
  m.sender_id = 6;
  other.endpoint.publish(kOfferChannel, m);
  run(network, 10, process);
  EXPECT_EQ(process.endpoint.session_id(), 1) << "the first one spoke a moment ago";
  run(network, 6000, process);
  begun = true;
  other.endpoint.publish(kOfferChannel, m);
  run(network, 10, process);
  EXPECT_EQ(process.endpoint.session_id(), 1);
  begun = false;
  other.endpoint.publish(kOfferChannel, m);
  run(network, 10, process);
  EXPECT_EQ(process.endpoint.session_id(), 2);
}

struct Waiting : Party {
  explicit Waiting(FakeNetwork& network, double give_up_s)
      : Party(network), presence(endpoint, "hp2_frontend"), stagnation(endpoint, presence, give_up_s) {
    Report report;
    report.text = "waiting for a back-end";
    presence.set(report);
  }
  // Seconds until it gives up; -1: it has not in so many.
  int gives_up(FakeNetwork& network, int seconds, bool busy = false) {
    for (int s = 0; s < seconds; ++s) {
      for (int i = 0; i < 10; ++i) {
        presence.poll();
        try {
          stagnation.tick(busy);
        } catch (const Error& e) {
          said = e.what();
          return s;
        }
        network.step(100'000);
      }
    }
    return -1;
  }
  Presence presence;
  Stagnation stagnation;
  std::string said;
};

TEST(Stagnation, EndsWithALineThatSaysForWhom) {
  FakeNetwork network;
  Waiting waiting(network, 120.0);
  EXPECT_NEAR(waiting.gives_up(network, 300), 120, 2);
  EXPECT_THAT(waiting.said, HasSubstr("nothing has happened for 120 s"));
  EXPECT_THAT(waiting.said, HasSubstr("waiting for a back-end"));
}

TEST(Stagnation, WorkHereOrThereIsProgressAndZeroIsForEver) {
  FakeNetwork network;
  Waiting waiting(network, 10.0);
  EXPECT_EQ(waiting.gives_up(network, 60, true), -1);
  Waiting patient(network, 0.0);
  EXPECT_EQ(patient.gives_up(network, 600), -1);
  // Another one that is busy; then it is silent.
  Waiting other(network, 10.0), worker(network, 0.0);
  worker.stagnation.tick(true);
  for (int s = 0; s < 30; ++s) {
    worker.presence.poll(true);
    ASSERT_EQ(other.gives_up(network, 1), -1) << s;
  }
  EXPECT_NE(other.gives_up(network, 60), -1);
  EXPECT_THAT(other.said, HasSubstr("silent for"));
}

}  // namespace
}  // namespace hp2
