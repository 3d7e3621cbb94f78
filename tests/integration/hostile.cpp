// Publishes rubbish on every channel: random bytes, truncated and altered messages, absurd counts, poses that
// are not numbers, commands of other sessions, a flood of STATUS; and past LCM: datagrams whose headers lie.
//   hp2_hostile URL MESSAGES SEED [SESSION]
// With SESSION some of them are of that session, which anybody can read on the bus.
#include <arpa/inet.h>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <hp2/chunk_t.hpp>
#include <hp2/closure_t.hpp>
#include <hp2/control_t.hpp>
#include <hp2/correction_t.hpp>
#include <hp2/fetch_t.hpp>
#include <hp2/graph_t.hpp>
#include <hp2/odometry_t.hpp>
#include <hp2/offer_t.hpp>
#include <hp2/resume_t.hpp>
#include <hp2/scan_t.hpp>
#include <hp2/status_t.hpp>
#include <hp2/submap_t.hpp>
#include <hp2/trajectory_t.hpp>
#include <initializer_list>
#include <limits>
#include <netinet/in.h>
#include <random>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <lcm/lcm-cpp.hpp>

namespace {

using Bytes = std::vector<std::uint8_t>;
std::mt19937_64 rng;  // NOLINT: one generator for the whole program

std::int64_t session = 0;  // of those who listen, if known

std::int64_t random_id() { return static_cast<std::int64_t>(rng() >> 2U); }

template <class T>
Bytes encode(const T& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

struct Message {
  const char* channel;
  Bytes bytes;
};

std::vector<Message> valid_messages() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<Message> all;
  hp2::scan_t scan{};
  scan.n = 50;
  scan.x.assign(50, std::nanf(""));
  scan.y = scan.x;
  scan.z = scan.x;
  scan.sequence = -1;
  scan.duration = 100000;
  all.push_back({"HP2_SCAN", encode(scan)});
  hp2::chunk_t chunk{};
  chunk.sender_id = random_id() | 1;
  chunk.message_id = random_id();
  chunk.count = 1000;
  chunk.index = static_cast<std::int32_t>(rng() % 1000);
  chunk.total_size = std::numeric_limits<std::int32_t>::max();
  chunk.size = 1000;
  chunk.data.assign(1000, 7);
  for (const char* channel : {"HP2_CHUNK_SCAN", "HP2_CHUNK_SUBMAP", "HP2_CHUNK_RESUME", "HP2_CHUNK_GRAPH",
                              "HP2_CHUNK_TRAJECTORY", "HP2_CHUNK_SESSION_SUBMAP"}) {
    all.push_back({channel, encode(chunk)});
  }
  chunk.total_size = 100'000'000;  // believable
  all.push_back({"HP2_CHUNK_SCAN", encode(chunk)});
  hp2::odometry_t odometry{};
  odometry.odom_from_sensor.translation[0] = nan;
  odometry.session_id = session;
  all.push_back({"HP2_ODOMETRY", encode(odometry)});
  hp2::offer_t offer{};
  offer.session_id = random_id();
  offer.sender_id = random_id();
  offer.topic = "SCAN";
  offer.first_id = -5;
  offer.next_id = std::numeric_limits<std::int64_t>::max();
  all.push_back({"HP2_OFFER", encode(offer)});
  hp2::fetch_t fetch{};
  fetch.session_id = random_id();
  fetch.topic = std::string(2000, 'T');
  fetch.n = 1000;
  fetch.indices.assign(1000, -1);
  all.push_back({"HP2_FETCH", encode(fetch)});
  hp2::control_t control{};
  control.session_id = rng() % 2 == 0 ? 0 : random_id();
  control.command = hp2::control_t::STOP;
  all.push_back({"HP2_CONTROL", encode(control)});
  hp2::status_t status{};
  status.sender_id = random_id();
  status.session_id = random_id();
  status.process = "../../../tmp/hp2_frontend";
  status.text = std::string(5000, 'x');
  all.push_back({"HP2_STATUS", encode(status)});
  status.session_id = session;  // and no UTF-8
  status.process = "\xff\x1b[2J" + std::to_string(rng() % 200);
  status.text = rng() % 2 == 0 ? "\xc3(</script>" : "warning: \xff" + std::to_string(rng());
  all.push_back({"HP2_STATUS", encode(status)});
  hp2::closure_t closure{};
  closure.session_id = session;
  closure.from_from_to.rotation[0] = nan;
  all.push_back({"HP2_CLOSURE", encode(closure)});
  hp2::correction_t correction{};
  correction.session_id = session;
  all.push_back({"HP2_CORRECTION", encode(correction)});
  return all;
}

void spoil(Bytes& bytes) {
  switch (rng() % 5) {
    case 0:  // truncated
      bytes.resize(rng() % (bytes.size() + 1));
      break;
    case 1:  // a count of 2^31-1, or a negative one, somewhere
      if (bytes.size() >= 12) {
        const std::size_t at = 8 + rng() % (bytes.size() - 11);
        const std::uint32_t value = rng() % 2 == 0 ? 0x7FFFFFFFU : 0xFFFFFFF0U;
        for (int k = 0; k < 4; ++k)
          bytes[at + static_cast<std::size_t>(k)] = static_cast<std::uint8_t>(value >> (24 - 8 * k));
      }
      break;
    case 2:  // wrong fingerprint
      bytes[rng() % 8] ^= 0x55U;
      break;
    case 3:  // some bytes altered
      for (int k = 0; k < 8; ++k) bytes[8 + rng() % (bytes.size() - 8)] = static_cast<std::uint8_t>(rng());
      break;
    default:  // as it is
      break;
  }
}

// Datagrams that LCM would not send.
class RawSender {
 public:
  explicit RawSender(const std::string& url) : socket_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    const auto begin = url.find("//") + 2, colon = url.find(':', begin);
    to_.sin_family = AF_INET;
    to_.sin_addr.s_addr = inet_addr(url.substr(begin, colon - begin).c_str());
    to_.sin_port = htons(static_cast<std::uint16_t>(std::atoi(url.c_str() + colon + 1)));
  }
  ~RawSender() { ::close(socket_); }
  RawSender(const RawSender&) = delete;
  RawSender& operator=(const RawSender&) = delete;

  void send(const std::string& channel) {
    Bytes d;
    const auto put = [&d](std::uint64_t value, int bytes) {
      for (int k = bytes - 1; k >= 0; --k) d.push_back(static_cast<std::uint8_t>(value >> (8 * k)));
    };
    const auto one_of = [](std::initializer_list<std::uint64_t> values) {
      return rng() % 4 == 0 ? rng() : values.begin()[rng() % values.size()];
    };
    const std::uint64_t kind = rng() % 5;
    if (kind == 1) {
      put(0x4c433032, 4);  // LC02
      put(rng(), 4);
    } else if (kind > 1) {
      put(0x4c433033, 4);  // LC03
      put(rng() % 4, 4);
      const std::uint64_t size =
          one_of({0, 1, 100, 5000, 1U << 20U, 1U << 28U, (1U << 28U) + 1, 0x7FFFFFFF, 0xFFFFFFFF});
      const std::uint64_t fragments = one_of({0, 1, 2, 3, 65535});
      put(size, 4);
      put(one_of({0, 1, 100, size, size - 50, 0x7FFFFFFF, 0xFFFFFFFF, 0xFFFFFF00}), 4);
      put(one_of({0, 0, 1, 2, fragments - 1, fragments, 65535}), 2);
      put(fragments, 2);
    }
    if (rng() % 4 != 0) {
      d.insert(d.end(), channel.begin(), channel.end());
      if (rng() % 4 != 0) d.push_back(0);
    }
    for (std::uint64_t n = rng() % 200; n > 0; --n) d.push_back(static_cast<std::uint8_t>(rng()));
    if (rng() % 4 == 0) d.resize(rng() % (d.size() + 1));
    ::sendto(socket_, d.data(), d.size(), 0, reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }

 private:
  int socket_;
  sockaddr_in to_{};
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 5) {
    std::fprintf(stderr, "usage: hp2_hostile URL MESSAGES SEED [SESSION]\n");
    return 2;
  }
  lcm::LCM lcm(argv[1]);
  if (!lcm.good()) return 1;
  const long messages = std::atol(argv[2]);
  if (argc == 5) session = std::atoll(argv[4]);
  rng.seed(static_cast<std::uint64_t>(std::atol(argv[3])));
  RawSender raw(argv[1]);
  std::vector<Message> valid = valid_messages();
  for (long i = 0; i < messages; ++i) {
    if (i % 1000 == 999) valid = valid_messages();
    Message message = valid[rng() % valid.size()];
    if (i % 20 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    if (rng() % 4 == 0) {
      raw.send(message.channel);
      continue;
    }
    if (rng() % 8 == 0) {
      message.bytes.resize(rng() % 3000);
      for (auto& byte : message.bytes) byte = static_cast<std::uint8_t>(rng());
    } else {
      spoil(message.bytes);
    }
    lcm.publish(message.channel, message.bytes.data(), static_cast<unsigned>(message.bytes.size()));
  }
  return 0;
}
