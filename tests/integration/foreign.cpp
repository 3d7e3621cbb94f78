// A stranger on the bus: sends one message after another that commands something and cannot be true, once
// each.
//   hp2_foreign URL
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <hp2/fetch_t.hpp>
#include <hp2/offer_t.hpp>
#include <hp2/status_t.hpp>
#include <map>
#include <string>

#include <lcm/lcm-cpp.hpp>

namespace {

constexpr std::int64_t kMe = 4711, kHuge = std::int64_t{1} << 50;

struct Stranger {
  lcm::LCM& lcm;
  std::map<std::string, hp2::offer_t> offers;

  void on_offer(const lcm::ReceiveBuffer*, const std::string&, const hp2::offer_t* offer) {
    if (offer->next_id < kHuge) offers[offer->topic] = *offer;
  }
  void listen(int ms) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(ms);
    while (std::chrono::steady_clock::now() < end) lcm.handleTimeout(20);
  }
  void fetch(const std::string& topic, std::int64_t done) {
    hp2::fetch_t m{};
    m.session_id = offers[topic].session_id;
    m.sender_id = kMe;
    m.target_id = offers[topic].sender_id;
    m.topic = topic;
    m.done_id = m.wanted_id = done;
    lcm.publish("HP2_FETCH", &m);
    std::printf("done with %s before %lld\n", topic.c_str(), static_cast<long long>(done));
    listen(700);
  }
  void offer(const std::string& topic, std::int64_t next, std::int8_t pacing) {
    hp2::offer_t m = offers[topic];
    m.first_id = 0;
    m.next_id = next;
    m.ended = 1;
    m.pacing = pacing;
    lcm.publish("HP2_OFFER", &m);
    std::printf("%s up to %lld in its owner's name\n", topic.c_str(), static_cast<long long>(next));
    listen(700);
  }
  void twin() {
    hp2::status_t m{};
    m.session_id = offers["SCAN"].session_id;
    m.sender_id = 1;
    m.process = "hp2_frontend";
    m.host = "elsewhere";
    m.state = hp2::status_t::RUNNING;
    m.n_counters = 1;
    m.counters.resize(1);
    m.counters[0].name = "session_begun";
    m.counters[0].value = 1;
    lcm.publish("HP2_STATUS", &m);
    std::printf("a twin's STATUS\n");
    listen(700);
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: hp2_foreign URL\n");
    return 2;
  }
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  lcm::LCM lcm(argv[1]);
  if (!lcm.good()) return 1;
  Stranger stranger{lcm, {}};
  lcm.subscribe("HP2_OFFER", &Stranger::on_offer, &stranger);
  const auto all_there = [&] {
    for (const char* topic : {"SCAN", "SUBMAP", "GRAPH", "RESUME"}) {
      if (stranger.offers.count(topic) == 0) return false;
    }
    return true;
  };
  for (int i = 0; i < 300 && !all_there(); ++i) stranger.listen(100);
  if (!all_there()) return 1;
  stranger.twin();
  stranger.fetch("SCAN", hp2::fetch_t::ALL);
  stranger.fetch("SCAN", kHuge);
  stranger.fetch("SUBMAP", kHuge);
  stranger.fetch("GRAPH", kHuge);
  stranger.fetch("RESUME", hp2::fetch_t::ALL);
  stranger.offer("SCAN", 3, hp2::offer_t::LOCKSTEP);
  stranger.offer("SCAN", kHuge, hp2::offer_t::REAL_TIME);
  stranger.offer("GRAPH", kHuge, hp2::offer_t::LOCKSTEP);
  stranger.offer("TRAJECTORY", kHuge, hp2::offer_t::LOCKSTEP);
  std::printf("all said\n");
  return 0;
}
