// A front-end whose submaps make no sense: waits for a back-end, offers submap 0 and answers who asks for it,
// with a message that is whole and yet no submap.
//   hp2_bad_frontend URL
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <hp2/chunk_t.hpp>
#include <hp2/fetch_t.hpp>
#include <hp2/offer_t.hpp>
#include <string>
#include <vector>

#include <lcm/lcm-cpp.hpp>

namespace {

constexpr std::int64_t kMe = 4711;

// CRC-32 as in zlib and PNG, bit by bit.
std::uint32_t crc32(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const auto byte : bytes) {
    crc ^= byte;
    for (int k = 0; k < 8; ++k) crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

struct BadFrontend {
  lcm::LCM& lcm;
  std::int64_t session = 0;
  long answers = 0;

  void on_offer(const lcm::ReceiveBuffer*, const std::string&, const hp2::offer_t* offer) {
    if (offer->topic == "RESUME") session = offer->session_id;
  }

  void on_fetch(const lcm::ReceiveBuffer*, const std::string&, const hp2::fetch_t* fetch) {
    if (fetch->target_id != kMe || fetch->n == 0) return;
    const std::vector<std::uint8_t> bytes(1000, 0xAB);
    hp2::chunk_t chunk{};
    chunk.session_id = session;
    chunk.sender_id = kMe;
    chunk.message_id = fetch->message_id;
    chunk.count = 1;
    chunk.total_size = chunk.size = static_cast<std::int32_t>(bytes.size());
    chunk.crc32 = static_cast<std::int32_t>(crc32(bytes));
    chunk.data = bytes;
    lcm.publish("HP2_CHUNK_SUBMAP", &chunk);
    ++answers;
  }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: hp2_bad_frontend URL\n");
    return 2;
  }
  lcm::LCM lcm(argv[1]);
  if (!lcm.good()) return 1;
  BadFrontend frontend{lcm};
  lcm.subscribe("HP2_OFFER", &BadFrontend::on_offer, &frontend);
  lcm.subscribe("HP2_FETCH", &BadFrontend::on_fetch, &frontend);
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(40);
  auto next_offer = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() < end) {
    lcm.handleTimeout(20);
    if (frontend.session == 0 || std::chrono::steady_clock::now() < next_offer) continue;
    next_offer = std::chrono::steady_clock::now() + std::chrono::milliseconds(200);
    hp2::offer_t offer{};
    offer.session_id = frontend.session;
    offer.sender_id = kMe;
    offer.topic = "SUBMAP";
    offer.next_id = 1;
    lcm.publish("HP2_OFFER", &offer);
  }
  std::printf("%ld answers\n", frontend.answers);
  return 0;
}
