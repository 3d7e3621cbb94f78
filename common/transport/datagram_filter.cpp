#include "common/transport/datagram_filter.hpp"

#include <array>
#include <cstdlib>
#include <filesystem>
#include <linux/filter.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <vector>

namespace hp2 {
namespace {

// Offsets from the UDP header, where the kernel's filter begins to count. LCM's headers: "LC02", number; or
// "LC03", number, size of the message, offset of the fragment, number of the fragment, number of fragments.
constexpr std::uint32_t kMagic = 8, kShortChannel = 16, kSize = 16, kOffset = 20, kFragment = 24,
                        kFragments = 26, kLongChannel = 28;
constexpr std::uint32_t kShort = 0x4c433032, kLong = 0x4c433033;
constexpr std::uint32_t kMostBytes = std::uint32_t{1} << 28;  // of a message, as LCM has it
constexpr std::uint32_t kLongestName = 63;

using Program = std::vector<sock_filter>;

// Bytes [at, at + value.size()) must be `value`, or the program goes on at its instruction `otherwise`. The
// last ones first: names begin alike, and a look into a datagram takes the kernel its time.
void expect(Program& p, std::uint32_t at, const std::string& value, std::size_t otherwise) {
  const auto size = static_cast<std::uint32_t>(value.size());
  for (std::uint32_t end = size; end > 0;) {
    const std::uint32_t bytes = end % 4 == 0 ? 4 : 1;
    end -= bytes;
    std::uint32_t word = 0;
    for (std::uint32_t k = 0; k < bytes; ++k) word = word << 8U | static_cast<std::uint8_t>(value[end + k]);
    const std::uint16_t width = bytes == 4 ? BPF_W : BPF_B;
    p.push_back({static_cast<std::uint16_t>(BPF_LD | width | BPF_ABS), 0, 0, at + end});
    p.push_back({BPF_JMP | BPF_JEQ | BPF_K, 0, static_cast<std::uint8_t>(otherwise - p.size() - 1), word});
  }
}

std::size_t instructions(std::size_t bytes) { return 2 * (bytes / 4 + bytes % 4); }

// The datagram must have so many bytes, or the program goes on at its instruction `otherwise`.
void expect_size(Program& p, std::size_t bytes, std::size_t otherwise) {
  p.push_back({BPF_LD | BPF_W | BPF_LEN, 0, 0, 0});
  p.push_back({BPF_JMP | BPF_JGE | BPF_K, 0, static_cast<std::uint8_t>(otherwise - p.size() - 1),
               static_cast<std::uint32_t>(bytes)});
}

std::string big_endian(std::uint64_t value) {
  std::string bytes;
  for (int shift = 56; shift >= 0; shift -= 8) bytes.push_back(static_cast<char>(value >> shift & 0xFFU));
  return bytes;
}

constexpr sock_filter kPass{BPF_RET | BPF_K, 0, 0, 0x7fffffff}, kThrowAway{BPF_RET | BPF_K, 0, 0, 0};

// Passes a short message on `channel`, if it is for this process, and goes on after itself with any other.
void pass_channel(Program& p, const std::string& channel, const WantedMessages::Addressed& addressed) {
  const std::string name(channel.c_str(), channel.size() + 1);  // with its zero
  const std::size_t message = kShortChannel + name.size();
  const bool look = channel == addressed.channel;
  const std::size_t pass = p.size() + 2 + instructions(name.size()) + (look ? 4 + 2 * instructions(8) : 0);
  const std::size_t next = pass + 1;
  expect_size(p, message, next);
  expect(p, kShortChannel, name, next);
  if (look) {  // what is no message of the type is for the process to refuse
    expect_size(p, message + addressed.offset + 8, pass);
    expect(p, static_cast<std::uint32_t>(message), big_endian(addressed.type), pass);
    expect(p, static_cast<std::uint32_t>(message + addressed.offset),
           big_endian(static_cast<std::uint64_t>(addressed.address)), pass - 1);
    p.push_back({BPF_JMP | BPF_JA, 0, 0, 1});
    p.push_back(kThrowAway);
  }
  p.push_back(kPass);
}

// A load past the end of the datagram ends the program with "drop".
Program program(const WantedMessages& wanted) {
  constexpr std::uint16_t kLoad = BPF_LD | BPF_W | BPF_ABS, kLoadHalf = BPF_LD | BPF_H | BPF_ABS;
  constexpr std::uint16_t kEqual = BPF_JMP | BPF_JEQ | BPF_K;
  constexpr std::uint32_t kIsShort = 11, kScan = 15;
  constexpr std::uint32_t kDrop = kScan + 2 * (kLongestName + 1), kAccept = kDrop + 1, kWanted = kAccept + 1;
  Program p;
  const auto to = [&p](std::uint32_t target) { return static_cast<std::uint8_t>(target - p.size() - 1); };
  p.push_back({kLoad, 0, 0, kMagic});
  p.push_back({kEqual, to(kIsShort), 0, kShort});
  p.push_back({kEqual, 0, to(kDrop), kLong});
  p.push_back({kLoad, 0, 0, kSize});
  p.push_back({BPF_JMP | BPF_JGT | BPF_K, to(kDrop), 0, kMostBytes});
  p.push_back({BPF_MISC | BPF_TAX, 0, 0, 0});
  p.push_back({kLoad, 0, 0, kOffset});
  p.push_back({BPF_JMP | BPF_JGT | BPF_X, to(kDrop), 0, 0});
  p.push_back({kLoadHalf, 0, 0, kFragments});
  p.push_back({kLoadHalf, 0, 0, kFragment});
  p.push_back({kEqual, to(kScan - 1), to(kAccept), 0});  // the first fragment has the channel's name
  p.push_back({BPF_JMP | BPF_JA, 0, 0, wanted.channels.empty() ? 0 : kWanted - kIsShort - 1});
  p.push_back({BPF_LDX | BPF_W | BPF_IMM, 0, 0, kShortChannel});
  p.push_back({BPF_JMP | BPF_JA, 0, 0, 1});
  p.push_back({BPF_LDX | BPF_W | BPF_IMM, 0, 0, kLongChannel});
  for (std::uint32_t i = 0; i <= kLongestName; ++i) {
    p.push_back({BPF_LD | BPF_B | BPF_IND, 0, 0, i});
    p.push_back({kEqual, to(kAccept), 0, 0});
  }
  p.push_back(kThrowAway);
  p.push_back(kPass);
  for (const auto& channel : wanted.channels) pass_channel(p, channel, wanted.addressed);
  if (!wanted.channels.empty()) p.push_back(kThrowAway);
  return p;
}

int port_of(const std::string& url) {
  const std::string scheme = "udpm://";
  if (url.rfind(scheme, 0) != 0) return -1;
  const auto end = url.find('?');
  const auto colon = url.find(':', scheme.size());
  return colon < end ? std::atoi(url.c_str() + colon + 1) : 7667;
}

// LCM does not tell its sockets: it is the one that is bound to the port.
int socket_bound_to(int port) {
  std::error_code ec;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd", ec)) {
    const int fd = std::atoi(entry.path().filename().c_str());
    sockaddr_in address{};
    socklen_t size = sizeof address;
    int type = 0;
    socklen_t type_size = sizeof type;
    if (::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) != 0 || type != SOCK_DGRAM) continue;
    if (::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) != 0) continue;
    if (address.sin_family == AF_INET && ntohs(address.sin_port) == port) return fd;
  }
  return -1;
}

}  // namespace

bool DatagramFilter::attach(const std::string& url, const WantedMessages& wanted) {
  const int port = port_of(url);
  if (port <= 0) return false;
  fd_ = socket_bound_to(port);
  if (fd_ < 0) return false;
  Program steps = program(wanted);
  const sock_fprog filter{static_cast<unsigned short>(steps.size()), steps.data()};
  return ::setsockopt(fd_, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0;
}

std::int64_t DatagramFilter::dropped() const {
  std::array<std::uint32_t, SK_MEMINFO_VARS> values{};
  socklen_t size = sizeof values;
  if (fd_ < 0 || ::getsockopt(fd_, SOL_SOCKET, SO_MEMINFO, values.data(), &size) != 0) return 0;
  return values[SK_MEMINFO_DROPS];
}

}  // namespace hp2
