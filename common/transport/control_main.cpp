// hp2_control: who is on the bus, and commands to them.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <map>
#include <set>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "common/error.hpp"
#include "common/program.hpp"
#include "common/text.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/process.hpp"

namespace {

using hp2::Error;

constexpr std::int64_t kListenUs = 1'300'000;
constexpr std::int64_t kRepeatUs = 50'000;
constexpr int kCheckScans = 12;
constexpr std::size_t kCheckScanBytes = 1'000'000;
constexpr std::int64_t kStopUs = 15'000'000, kTellAgainUs = 500'000, kSilentUs = 2'500'000;

std::function<bool()> until(const hp2::LcmBus& bus, std::int64_t us) {
  return [&bus, end = bus.now_us() + us] { return bus.now_us() < end; };
}

// Says it again until those who are meant have ended: a process that is busy, or stands still, loses
// datagrams.
void stop(hp2::LcmBus& bus, hp2::Endpoint& endpoint, const hp2::Presence& presence,
          const hp2::control_t& command) {
  std::set<std::string> left;
  for (const std::int64_t end = bus.now_us() + kStopUs; bus.now_us() < end;) {
    bus.run(until(bus, kTellAgainUs));
    left.clear();
    for (const auto& [id, peer] : presence.peers()) {
      const auto& s = peer.status;
      const bool meant =
          s.session_id == command.session_id && (command.target.empty() || command.target == s.process);
      const bool ended = s.state == hp2::status_t::FINISHED || s.state == hp2::status_t::FAILED ||
                         bus.now_us() - peer.heard_us > kSilentUs;
      if (meant && !ended) left.insert(s.process + ": " + s.text);
    }
    if (left.empty()) return;
    endpoint.publish(hp2::kControlChannel, command);
  }
  for (const auto& who : left) std::printf("told to stop, not ended yet: %s\n", who.c_str());
}

// Processes whose STATUS came in a little more than a second.
std::map<std::int64_t, hp2::Peer> listen(hp2::LcmBus& bus, const hp2::Presence& presence) {
  bus.run(until(bus, kListenUs));
  return presence.peers();
}

std::int64_t the_session(const std::map<std::int64_t, hp2::Peer>& peers) {
  std::set<std::int64_t> sessions;
  for (const auto& [id, peer] : peers) {
    if (peer.status.session_id != 0) sessions.insert(peer.status.session_id);
  }
  if (sessions.empty()) {
    throw Error("nobody is on the bus", "LCM", "Start the processes first, with the same --lcm-url.");
  }
  if (sessions.size() > 1) {
    std::string all;
    for (const auto id : sessions) all += " " + std::to_string(id);
    throw Error("several sessions are on the bus", "sessions" + all, "Say which one with --session.");
  }
  return *sessions.begin();
}

void print(const std::map<std::int64_t, hp2::Peer>& peers, const std::string& url) {
  if (peers.empty())
    std::printf("no process has been heard on %s in %.1f s\n", url.c_str(),
                1e-6 * static_cast<double>(kListenUs));
  for (const auto& [id, peer] : peers) {
    const auto& s = peer.status;
    std::printf("%s\n",
                fmt::format("{:20} pid {:7} session {} done {} of {}, {:.1f}/s, {:.0f} MB: {}", s.process,
                            s.pid, s.session_id, s.done, s.total, s.rate, s.peak_memory_mb, s.text)
                    .c_str());
  }
}

// Whether multicast comes back at all. @throws Error if not
void check_reachable(hp2::LcmBus& bus) {
  bool heard = false;
  bus.subscribe(
      "HP2_CHECK", [&](const auto*, auto) { heard = true; }, 4);
  const std::int64_t end = bus.now_us() + 500'000;
  bus.run([&] {
    bus.publish("HP2_CHECK", "?", 1);
    return !heard && bus.now_us() < end;
  });
  if (!heard) {
    throw Error("multicast does not come back", bus.url(),
                "Run as root: ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo");
  }
}

// What a receiver on this machine gets of scans of 1 MB that come 10 times a second, whole or in pieces,
// while it works between them.
int count_scans(const std::string& url, bool pieces) {
  constexpr std::int64_t kPeriodUs = 100'000;
  const std::string channel = pieces ? "HP2_CHECK_PIECE" : "HP2_CHECK_WHOLE";
  hp2::LcmBus receiver(url);
  std::map<std::uint32_t, std::size_t> bytes;
  receiver.subscribe(
      channel,
      [&](const std::uint8_t* data, std::size_t size) {
        std::uint32_t scan = 0;
        std::memcpy(&scan, data, sizeof scan);
        bytes[scan] += size;
      },
      400);
  std::atomic<bool> sending{true};
  std::thread sender([&] {
    hp2::LcmBus bus(url);
    for (std::uint32_t scan = 0; scan < kCheckScans; ++scan) {
      const std::int64_t next = bus.now_us() + kPeriodUs;
      std::vector<std::uint8_t> data(pieces ? hp2::kPieceBytes : kCheckScanBytes);
      std::memcpy(data.data(), &scan, sizeof scan);
      for (std::size_t sent = 0; sent < kCheckScanBytes; sent += data.size()) {
        data.resize(std::min(data.size(), kCheckScanBytes - sent));
        bus.publish(channel, data.data(), data.size());
        if (pieces) std::this_thread::sleep_for(std::chrono::microseconds(300));
      }
      while (bus.now_us() < next) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    sending = false;
  });
  std::int64_t end = 0;
  receiver.run([&] {
    if (!sending && end == 0) end = receiver.now_us() + 200'000;
    return end == 0 || receiver.now_us() < end;
  });
  sender.join();
  return static_cast<int>(
      std::count_if(bytes.begin(), bytes.end(), [](const auto& b) { return b.second == kCheckScanBytes; }));
}

// lcm-logger and other programs that do not ask for a larger buffer get the system's default.
std::string with_buffer(const std::string& url, int bytes) {
  const auto at = url.find("recv_buf_size");
  const std::string plain = at == std::string::npos ? url : url.substr(0, at - 1);
  return plain + (plain.find('?') == std::string::npos ? "?" : "&") +
         "recv_buf_size=" + std::to_string(bytes);
}

int number_in(const char* path, int otherwise) {
  std::ifstream file(path);
  int value = 0;
  return file >> value ? value : otherwise;
}

void check(hp2::LcmBus& bus) {
  constexpr int kWanted = 4 << 20, kUsual = 212'992;
  std::printf("multicast works: %s\n", bus.url().c_str());
  if (bus.url().rfind("udpm://", 0) != 0) return;
  const int most = number_in("/proc/sys/net/core/rmem_max", kUsual);
  const int usual = number_in("/proc/sys/net/core/rmem_default", kUsual);
  const std::string plain = with_buffer(bus.url(), usual),
                    wide = with_buffer(bus.url(), std::max(kWanted, most));
  std::printf("receive buffer: %d bytes by default, %d at most (net.core.rmem_default, rmem_max)\n", usual,
              most);
  std::printf("of %d scans of %zu bytes, 10 a second, there came\n", kCheckScans, kCheckScanBytes);
  const int whole = count_scans(plain, false), asked = count_scans(wide, false),
            pieces = count_scans(plain, true);
  std::printf("  whole, default buffer (lcm-logger as it is)       %d\n", whole);
  std::printf("  whole, largest buffer (recv_buf_size in the URL)  %d\n", asked);
  std::printf("  in pieces of %zu bytes (chunk_t), default buffer  %d\n", hp2::kPieceBytes, pieces);
  if (whole == kCheckScans && pieces == kCheckScans) {
    std::printf(
        "Nothing was lost on this machine, idle as it was; under load only pieces and a large buffer are "
        "safe.\n");
    return;
  }
  std::printf(
      "Whole scans of this size are lost with the default buffer. Remedies, best first:\n"
      "  the driver sends scans in pieces, as chunk_t on HP2_CHUNK_SCAN (lcmtypes/README.md)\n");
  if (most < kWanted) std::printf("  a larger limit, as root: sysctl -w net.core.rmem_max=%d\n", 2 * kWanted);
  std::printf("  and for lcm-logger and drivers of your own: --lcm-url=%s\n",
              hp2::shell_quoted(with_buffer(bus.url(), 2 * kWanted)).c_str());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Lists the processes on the bus and sends them commands.", "hp2_control");
  std::string command, target;
  bool quick = false;
  std::int64_t argument = 1, session = 0;
  hp2::CommonOptions common;
  static const std::map<std::string, int> kCommands{{"pause", hp2::control_t::PAUSE},
                                                    {"resume", hp2::control_t::RESUME},
                                                    {"step", hp2::control_t::STEP},
                                                    {"stop", hp2::control_t::STOP},
                                                    {"export", hp2::control_t::EXPORT}};
  app.add_option("COMMAND", command,
                 "list; check (does multicast work here, and do large scans come through?); pause, resume, "
                 "step (the player); stop (the "
                 "session is ended: what was registered is stored and written, then all leave); export (the "
                 "viewer writes now)")
      ->required()
      ->check(CLI::IsMember({"list", "check", "pause", "resume", "step", "stop", "export"}));
  app.add_option("N", argument, "step: number of scans")->check(CLI::PositiveNumber);
  app.add_option("--target", target, "Only this process, e.g. hp2_frontend")->type_name("NAME");
  app.add_option("--session", session, "Session id; default: the only one on the bus")->type_name("ID");
  app.add_flag("--quick", quick, "check: multicast alone, without the measurement of 4 s");
  hp2::add_common_options(app, common, false);
  app.footer(
      "Examples:\n"
      "  hp2_control list\n"
      "  hp2_control pause; hp2_control step 10; hp2_control resume\n"
      "  hp2_control stop                           ends the session, e.g. of a live sensor");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_control", [&] {
    hp2::apply_common_options(common, nullptr);
    hp2::LcmBus bus(common.lcm_url);
    if (command == "check") {
      check_reachable(bus);
      if (quick) {
        std::printf("multicast works: %s\n", bus.url().c_str());
      } else {
        check(bus);
      }
      return 0;
    }
    hp2::Endpoint endpoint(bus);
    const hp2::Presence presence(endpoint, "hp2_control");
    const auto peers = listen(bus, presence);
    if (command == "list") {
      print(peers, bus.url());
      return peers.empty() ? 1 : 0;
    }
    hp2::control_t m;
    m.session_id = session != 0 ? session : the_session(peers);
    m.target = target;
    m.command = static_cast<std::int8_t>(kCommands.at(command));
    m.argument = argument;
    endpoint.publish(hp2::kControlChannel, m);
    if (m.command == hp2::control_t::STOP) {
      stop(bus, endpoint, presence, m);
    } else if (m.command != hp2::control_t::STEP) {
      // May be lost on the way; PAUSE, RESUME and EXPORT do no harm twice.
      bus.run(until(bus, kRepeatUs));
      endpoint.publish(hp2::kControlChannel, m);
    }
    return 0;
  });
}
