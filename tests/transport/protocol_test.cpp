#include <memory>
#include <random>

#include <gtest/gtest.h>

#include "common/error.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/inbox.hpp"
#include "common/transport/outbox.hpp"
#include "tests/transport/fake_bus.hpp"

namespace hp2 {
namespace {

constexpr std::int64_t kSession = 77;

ByteVector message_bytes(std::int64_t id) {
  std::mt19937 rng(static_cast<unsigned>(id));
  ByteVector bytes(8 + rng() % 400'000);
  for (auto& b : bytes) b = static_cast<std::uint8_t>(rng());
  return bytes;
}

struct Owner {
  explicit Owner(FakeNetwork& network, const std::string& topic = "T")
      : bus(network), endpoint(bus), outbox(endpoint, topic, [this](std::int64_t id) { return get(id); }) {
    endpoint.set_session(kSession);
  }
  EncodedMessagePtr get(std::int64_t id) {
    auto& m = messages[id];
    if (!m) m = std::make_shared<EncodedMessage>(message_bytes(id));
    return m;
  }
  FakeBus bus;
  Endpoint endpoint;
  std::map<std::int64_t, EncodedMessagePtr> messages;
  Outbox outbox;
};

struct Reader {
  explicit Reader(FakeNetwork& network, Inbox::Options options = {"T"})
      : bus(network), endpoint(bus), inbox(endpoint, options, [this](Delivery d) { take(std::move(d)); }) {
    endpoint.set_session(kSession);
    inbox.on_unasked([this](Delivery d) { unasked.push_back(d.id); });
  }
  void take(Delivery d) {
    ids.push_back(d.id);
    const auto expected = message_bytes(d.id);
    ASSERT_EQ(d.bytes->size(), expected.size());
    EXPECT_TRUE(std::equal(expected.begin(), expected.end(), d.bytes->data()));
  }
  FakeBus bus;
  Endpoint endpoint;
  Inbox inbox;
  std::vector<std::int64_t> ids, unasked;
};

std::vector<std::int64_t> range(std::int64_t first, std::int64_t next) {
  std::vector<std::int64_t> v;
  for (; first < next; ++first) v.push_back(first);
  return v;
}

template <class... Parties>
void run(FakeNetwork& network, int steps, Parties&... parties) {
  for (int i = 0; i < steps; ++i) {
    (parties.endpoint.poll(), ...);
    network.step(1000);
  }
}

/// Of receive buffers of several sizes [large datagrams].
class ProtocolCapacities : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Capacities, ProtocolCapacities, ::testing::Values(2, 3, 4, 9, 22, 88));

TEST_P(ProtocolCapacities, AllMessagesArriveInOrderAndNeverOverrunTheReceiveBuffer) {
  FakeNetwork network(GetParam());
  Owner owner(network);
  Reader reader(network);
  owner.outbox.offer(0, 30, true);
  run(network, 500, owner, reader);
  EXPECT_EQ(reader.ids, range(0, 30));
  EXPECT_EQ(network.overflowed, 0);
  EXPECT_EQ(owner.endpoint.counters()["chunks_resent"], 0);
}

TEST_P(ProtocolCapacities, SurvivesLossDuplicationAndReordering) {
  FakeNetwork network(GetParam());
  network.loss = 0.1;
  network.duplication = 0.05;
  network.reordering = 0.2;
  Owner owner(network);
  Reader reader(network);
  owner.outbox.offer(0, 50, true);
  run(network, 30'000, owner, reader);
  EXPECT_EQ(reader.ids, range(0, 50));
  EXPECT_GT(owner.endpoint.counters()["chunks_resent"], 0);
}

TEST(Protocol, DamagedBytesAreNoticedAndAskedForAgain) {
  FakeNetwork network;
  int count = 0;
  network.tamper = [&](const std::string& channel, auto& bytes) {
    if (channel == "HP2_CHUNK_T" && ++count % 7 == 0) bytes[bytes.size() / 2] ^= 1U;
  };
  Owner owner(network);
  Reader reader(network);
  owner.outbox.offer(0, 10, true);
  run(network, 5000, owner, reader);
  EXPECT_EQ(reader.ids, range(0, 10));
  EXPECT_GT(reader.endpoint.counters()["rejected"], 0);
}

TEST(Protocol, AnOwnerThatDiesIsReplacedByTheNext) {
  FakeNetwork network;
  auto owner = std::make_unique<Owner>(network);
  Reader reader(network);
  owner->outbox.offer(0, 40, true);
  reader.inbox.set_limit(20);
  run(network, 100, *owner, reader);
  reader.inbox.set_limit(40);  // asks for the next pieces, which come to nothing
  owner.reset();
  EXPECT_EQ(reader.ids, range(0, 20));
  run(network, 3000, reader);
  Owner again(network);
  again.outbox.offer(0, 40, true);
  run(network, 3000, again, reader);
  EXPECT_EQ(reader.ids, range(0, 40));
}

TEST(Protocol, AReaderThatDiesIsReplacedByTheNextWhereItSaysItIs) {
  FakeNetwork network;
  Owner owner(network);
  auto reader = std::make_unique<Reader>(network);
  owner.outbox.offer(0, 40, true);
  run(network, 10, owner, *reader);
  reader->inbox.acknowledge(8, 5);
  run(network, 30, owner, *reader);
  EXPECT_EQ(owner.outbox.done_id(), 5);
  EXPECT_EQ(owner.outbox.wanted_id(), 8);
  reader.reset();
  Reader next(network);
  next.inbox.seek(5);
  run(network, 3000, owner, next);
  EXPECT_EQ(next.ids, range(5, 40));
}

TEST(Protocol, TheConsumerSetsThePace) {
  FakeNetwork network;
  Owner owner(network);
  Reader reader(network);
  reader.inbox.set_limit(3);
  owner.outbox.offer(0, 40, true);
  run(network, 500, owner, reader);
  EXPECT_EQ(reader.ids, range(0, 3));
  reader.inbox.set_limit(7);
  run(network, 500, owner, reader);
  EXPECT_EQ(reader.ids, range(0, 7));
}

TEST(Protocol, LatestSkipsWhatIsOutdated) {
  FakeNetwork network;
  Owner owner(network);
  Reader reader(network, {"T", Inbox::Order::kLatest});
  owner.outbox.offer(3, 4, false);
  run(network, 300, owner, reader);
  owner.outbox.offer(9, 10, false);
  run(network, 300, owner, reader);
  EXPECT_EQ(reader.ids, (std::vector<std::int64_t>{3, 9}));
}

TEST(Protocol, MessagesThatAreNotReadyYetComeWhenTheyAre) {
  FakeNetwork network;
  FakeBus bus(network);
  Endpoint endpoint(bus);
  endpoint.set_session(kSession);
  bool ready = false;
  const auto message = std::make_shared<EncodedMessage>(message_bytes(0));
  Outbox outbox(endpoint, "T", [&](std::int64_t) { return ready ? message : nullptr; });
  Reader reader(network);
  outbox.offer(0, 1, true);
  for (int i = 0; i < 300; ++i) {
    if (i == 200) ready = true;
    endpoint.poll();
    reader.endpoint.poll();
    network.step(1000);
  }
  EXPECT_EQ(reader.ids, range(0, 1));
}

// As a recording of them has them: a replay knows no other order.
TEST(Protocol, MessagesGoOutInTheirOrderWhicheverIsReadyFirst) {
  FakeNetwork network(88);
  FakeBus bus(network), listener(network);
  Endpoint endpoint(bus);
  endpoint.set_session(kSession);
  std::map<std::int64_t, EncodedMessagePtr> ready;
  Outbox outbox(endpoint, "T", [&](std::int64_t id) { return ready.count(id) != 0 ? ready[id] : nullptr; });
  std::map<std::int64_t, int> pieces;
  std::vector<std::int64_t> whole;
  listener.subscribe(
      "HP2_CHUNK_T",
      [&](const std::uint8_t* data, std::size_t size) {
        const auto piece = view_chunk(data, size);
        ASSERT_TRUE(piece);
        if (++pieces[piece->fields.message_id] == piece->fields.count)
          whole.push_back(piece->fields.message_id);
      },
      100);
  FakeBus reader_bus(network);
  Endpoint reader(reader_bus);
  reader.set_session(kSession);
  std::vector<std::int64_t> delivered;
  Inbox inbox(reader, {"T"}, [&](const Delivery& d) { delivered.push_back(d.id); });
  outbox.offer(0, 8, true);
  for (int i = 0; i < 400; ++i) {
    const std::int64_t id = i / 10 < 8 ? (i / 10) ^ 3 : 8;  // 3 2 1 0 7 6 5 4
    if (i % 10 == 0 && id < 8) ready[id] = std::make_shared<EncodedMessage>(ByteVector(200'000, 7));
    endpoint.poll();
    reader.poll();
    network.step(1000);
  }
  EXPECT_EQ(delivered, range(0, 8));
  EXPECT_EQ(whole, range(0, 8));
}

TEST(Protocol, OtherSessionsAndTwinsAreLeftAlone) {
  FakeNetwork network;
  Owner owner(network), twin(network), other(network);
  other.endpoint.set_session(kSession + 1);
  Reader reader(network);
  owner.outbox.offer(0, 5, true);
  run(network, 1, owner, reader);
  twin.outbox.offer(0, 20, true);
  other.outbox.offer(0, 30, true);
  run(network, 500, owner, twin, other, reader);
  EXPECT_EQ(reader.ids, range(0, 5));
  EXPECT_EQ(twin.endpoint.counters()["chunks_sent"], 0);
  EXPECT_EQ(other.endpoint.counters()["chunks_sent"], 0);
}

TEST(Protocol, UnaskedPiecesAreTakenWhereAllowed) {
  FakeNetwork network;
  Owner owner(network);
  Reader recorder(network);  // its wishes make the owner send
  Inbox::Options options{"T"};
  options.accept_unasked = true;
  Reader listener(network, options);
  listener.endpoint.set_session(0);  // hears no offer, as in the replay of a recording
  owner.outbox.send_for_any_session();
  owner.outbox.offer(0, 10, true);
  run(network, 500, owner, recorder, listener);
  EXPECT_EQ(recorder.ids, range(0, 10));
  EXPECT_EQ(listener.unasked, range(0, 10));
}

// The first piece of a message that nobody asked for.
ByteVector first_piece(std::int64_t sender, std::int64_t id, std::int32_t total) {
  chunk_t chunk{};
  chunk.sender_id = sender;
  chunk.message_id = id;
  chunk.count = total / 50'000 + 2;
  chunk.total_size = total;
  chunk.data.assign(50'000, 1);
  chunk.size = 50'000;
  return encode_message(chunk);
}

TEST(Protocol, UnaskedMessagesThatAreNeverWholeAreForgottenAndCounted) {
  FakeNetwork network(88);
  FakeBus stranger(network);
  Inbox::Options options{"T"};
  options.accept_unasked = true;
  Reader reader(network, options);
  for (int i = 0; i < 4; ++i) {
    const ByteVector piece = first_piece(100 + i, i, 90 << 20);
    stranger.publish("HP2_CHUNK_T", piece.data(), piece.size());
    run(network, 10, reader);
  }
  EXPECT_GT(reader.inbox.unasked_bytes(), 0U);
  run(network, 2500, reader);
  EXPECT_EQ(reader.inbox.unasked_bytes(), 0U);
  EXPECT_EQ(reader.endpoint.counters()["lost"], 4);
}

TEST(Protocol, UnaskedMessagesThatAreNeverWholeHoldBoundedMemory) {
  FakeNetwork network(88);
  FakeBus stranger(network);
  Inbox::Options options{"T"};
  options.accept_unasked = true;
  Reader reader(network, options);
  for (int i = 0; i < 50; ++i) {
    const ByteVector piece = first_piece(100 + i, i, 200 << 20);
    stranger.publish("HP2_CHUNK_T", piece.data(), piece.size());
    run(network, 1, reader);
    EXPECT_LE(reader.inbox.unasked_bytes(), 2 * kMaxMessageBytes);
  }
  EXPECT_GE(reader.endpoint.counters()["lost"], 47);
}

TEST(Protocol, AllPiecesAtOnceAreSentSlowlyEnough) {
  FakeNetwork network;
  Owner owner(network);
  FakeBus bus(network);
  std::size_t got = 0;
  bus.subscribe(
      "HP2_CHUNK_T", [&](const auto*, auto) { ++got; }, 100);
  owner.outbox.offer(0, 3, true);
  fetch_t fetch{};
  fetch.session_id = kSession;
  fetch.sender_id = 5;
  fetch.target_id = owner.endpoint.sender_id();
  fetch.topic = "T";
  fetch.message_id = 2;
  fetch.n = 1;
  fetch.indices = {-1};
  const auto bytes = encode_message(fetch);
  bus.publish(kFetchChannel, bytes.data(), bytes.size());
  run(network, 100, owner);
  EXPECT_EQ(got, (message_bytes(2).size() + kPieceBytes - 1) / kPieceBytes);
  EXPECT_EQ(network.overflowed, 0);
}

TEST(Limits, TheSenderNamesTheScanThatIsBeyondThem) {
  Scan scan;
  scan.x.resize(kMaxScanPoints + 1);
  try {
    check_scan_limits(scan, "drive/, scan 12");
    FAIL() << "it passes";
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("4000001 points"), std::string::npos);
    EXPECT_NE(std::string(e.what()).find("4000000"), std::string::npos);
    EXPECT_NE(std::string(e.what()).find("drive/, scan 12"), std::string::npos);
  }
  EXPECT_THROW(EncodedMessage(ByteVector(kMaxMessageBytes + 1), 0), Error);
}

}  // namespace
}  // namespace hp2
