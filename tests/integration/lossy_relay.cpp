// Joins two multicast groups, as a bad network would: drops some datagrams, holds some back until later ones
// have gone.
//   hp2_lossy_relay GROUP_A:PORT_A GROUP_B:PORT_B LOSS REORDER        e.g. 239.1.1.1:7001 239.1.1.2:7002 0.02
//   0.01
#include <arpa/inet.h>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <netinet/in.h>
#include <optional>
#include <poll.h>
#include <random>
#include <set>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <vector>

namespace {

volatile std::sig_atomic_t g_stop = 0;

struct Side {
  int in = -1, out = -1;
  sockaddr_in address{};
  std::optional<std::vector<char>> held;  // goes out after the next one
  long passed = 0, dropped = 0, reordered = 0;
};

Side open_side(const std::string& spec) {
  Side side;
  const auto colon = spec.find(':');
  side.address.sin_family = AF_INET;
  side.address.sin_addr.s_addr = inet_addr(spec.substr(0, colon).c_str());
  side.address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(spec.substr(colon + 1))));
  side.in = ::socket(AF_INET, SOCK_DGRAM, 0);
  const int one = 1, zero = 0, size = 8 << 20;
  const unsigned char ttl = 0;
  ::setsockopt(side.in, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  ::setsockopt(side.in, SOL_SOCKET, SO_REUSEPORT, &one, sizeof one);
  ::setsockopt(side.in, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
  ::setsockopt(side.in, IPPROTO_IP, IP_MULTICAST_ALL, &zero, sizeof zero);
  ip_mreq group{side.address.sin_addr, {htonl(INADDR_ANY)}};
  ::setsockopt(side.in, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group);
  if (::bind(side.in, reinterpret_cast<const sockaddr*>(&side.address), sizeof side.address) != 0) {
    std::perror("bind");
    std::exit(1);
  }
  side.out = ::socket(AF_INET, SOCK_DGRAM, 0);
  ::setsockopt(side.out, SOL_SOCKET, SO_SNDBUF, &size, sizeof size);
  ::setsockopt(side.out, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  return side;
}

// What this relay sent itself comes back to it: known by the port that it was sent from.
std::uint16_t own_port(int socket) {
  sockaddr_in address{};
  socklen_t size = sizeof address;
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size);
  return address.sin_port;
}

void send(Side& to, const std::vector<char>& bytes) {
  ::sendto(to.out, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to.address),
           sizeof to.address);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fprintf(stderr, "usage: hp2_lossy_relay GROUP:PORT GROUP:PORT LOSS REORDER\n");
    return 2;
  }
  std::signal(SIGTERM, [](int) { g_stop = 1; });
  std::array<Side, 2> sides{open_side(argv[1]), open_side(argv[2])};
  const double loss = std::atof(argv[3]), reorder = std::atof(argv[4]);
  std::mt19937 rng(11);
  std::uniform_real_distribution<> uniform(0, 1);
  std::vector<char> buffer(1 << 17);
  for (auto& side : sides) send(side, {});  // gives the sockets their ports
  std::set<std::uint16_t> own{own_port(sides[0].out), own_port(sides[1].out)};
  while (g_stop == 0) {
    std::array<pollfd, 2> fds{pollfd{sides[0].in, POLLIN, 0}, pollfd{sides[1].in, POLLIN, 0}};
    if (::poll(fds.data(), 2, 20) == 0) {
      for (auto& side : sides) {
        if (side.held) send(side, *side.held);
        side.held.reset();
      }
      continue;
    }
    for (std::size_t i = 0; i < 2; ++i) {
      if ((fds[i].revents & POLLIN) == 0) continue;
      sockaddr_in from{};
      socklen_t from_size = sizeof from;
      const ssize_t n = ::recvfrom(sides[i].in, buffer.data(), buffer.size(), 0,
                                   reinterpret_cast<sockaddr*>(&from), &from_size);
      if (n <= 0 || own.count(from.sin_port) != 0) continue;
      Side& to = sides[1 - i];
      std::vector<char> bytes(buffer.begin(), buffer.begin() + n);
      if (uniform(rng) < loss) {
        ++to.dropped;
        continue;
      }
      ++to.passed;
      if (!to.held && uniform(rng) < reorder) {
        ++to.reordered;
        to.held = std::move(bytes);
        continue;
      }
      send(to, bytes);
      if (to.held) send(to, *to.held);
      to.held.reset();
    }
  }
  for (const auto& side : sides) {
    std::printf("passed %ld, dropped %ld, reordered %ld\n", side.passed, side.dropped, side.reordered);
  }
  return 0;
}
