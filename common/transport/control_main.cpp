// hp2_control: who is on the bus, and commands to them.
#include <cstdio>
#include <functional>
#include <map>
#include <set>

#include <fmt/format.h>

#include "common/error.hpp"
#include "common/program.hpp"
#include "common/transport/channels.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/presence.hpp"
#include "common/transport/process.hpp"

namespace {

using hp2::Error;

constexpr std::int64_t kListenUs = 1'300'000;
constexpr std::int64_t kRepeatUs = 50'000;
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

void print(const std::map<std::int64_t, hp2::Peer>& peers) {
  for (const auto& [id, peer] : peers) {
    const auto& s = peer.status;
    std::printf("%s\n",
                fmt::format("{:20} pid {:7} session {} done {} of {}, {:.1f}/s, {:.0f} MB: {}", s.process,
                            s.pid, s.session_id, s.done, s.total, s.rate, s.peak_memory_mb, s.text)
                    .c_str());
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Lists the processes on the bus and sends them commands.", "hp2_control");
  std::string command, target;
  std::int64_t argument = 1, session = 0;
  hp2::CommonOptions common;
  static const std::map<std::string, int> kCommands{{"pause", hp2::control_t::PAUSE},
                                                    {"resume", hp2::control_t::RESUME},
                                                    {"step", hp2::control_t::STEP},
                                                    {"stop", hp2::control_t::STOP},
                                                    {"export", hp2::control_t::EXPORT}};
  app.add_option("COMMAND", command,
                 "list; check (does multicast work here?); pause, resume, step (the player); stop (the "
                 "session is ended: what was registered is stored and written, then all leave); export (the "
                 "viewer writes now)")
      ->required()
      ->check(CLI::IsMember({"list", "check", "pause", "resume", "step", "stop", "export"}));
  app.add_option("N", argument, "step: number of scans")->check(CLI::PositiveNumber);
  app.add_option("--target", target, "Only this process, e.g. hp2_frontend")->type_name("NAME");
  app.add_option("--session", session, "Session id; default: the only one on the bus")->type_name("ID");
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
      return 0;
    }
    hp2::Endpoint endpoint(bus);
    const hp2::Presence presence(endpoint, "hp2_control");
    const auto peers = listen(bus, presence);
    if (command == "list") {
      print(peers);
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
