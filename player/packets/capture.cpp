#include "player/packets/capture.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <cstdio>
#include <deque>
#include <mutex>
#include <optional>
#include <pcap/pcap.h>
#include <vector>

#include "common/error.hpp"

namespace hp2 {
namespace {

constexpr std::size_t kMostPending = 64;     // datagrams whose fragments are not all there
constexpr std::uint64_t kSearchedOn = 1000;  // records after the last one wanted, for its last fragment
constexpr std::int64_t kMostReceived_us = 4'000'000'000'000'000;

unsigned big16(std::string_view b, std::size_t at) {
  return static_cast<unsigned char>(b[at]) * 256U + static_cast<unsigned char>(b[at + 1]);
}

/// The IPv4 packet in a captured frame; nothing if there is none.
std::optional<std::string_view> ip_packet(std::string_view frame, int link_type) {
  const auto after = [&](std::size_t header, std::size_t type_at) -> std::optional<std::string_view> {
    while (frame.size() >= header + 4 &&
           (big16(frame, type_at) == 0x8100 || big16(frame, type_at) == 0x88a8)) {
      header += 4;  // a VLAN's tag
      type_at += 4;
    }
    if (frame.size() < header || big16(frame, type_at) != 0x0800) return std::nullopt;
    return frame.substr(header);
  };
  switch (link_type) {
    case DLT_EN10MB:
      return frame.size() >= 14 ? after(14, 12) : std::nullopt;
    case DLT_LINUX_SLL:
      return frame.size() >= 16 ? after(16, 14) : std::nullopt;
    case DLT_LINUX_SLL2:
      return frame.size() >= 20 ? after(20, 0) : std::nullopt;
    case DLT_NULL:
    case DLT_LOOP:
      return frame.size() >= 4 ? std::optional(frame.substr(4)) : std::nullopt;
    case DLT_RAW:
    case DLT_IPV4:
    case 101:  // LINKTYPE_RAW
      return frame;
    default:
      return std::nullopt;
  }
}

/// A datagram of which fragments have come.
struct Pending {
  std::string id;  ///< Addresses and number of the IP packet.
  std::uint64_t key = 0;
  std::size_t size = 0;  ///< Of the whole; 0 while the last fragment is missing.
  std::string bytes;
  std::vector<std::pair<std::size_t, std::size_t>> parts;  ///< Begin and end of what is there.

  bool is_whole() {
    if (size == 0) return false;
    std::sort(parts.begin(), parts.end());
    std::size_t reached = 0;
    for (const auto& [begin, end] : parts) {
      if (begin > reached) return false;
      reached = std::max(reached, end);
    }
    return reached >= size;
  }
};

/// Joins the fragments of IP packets.
class Joiner {
 public:
  /// The UDP datagram that this packet completes (header and data), and its key; nothing if there is none
  /// yet.
  std::optional<std::string_view> add(std::string_view ip, std::uint64_t key, std::uint64_t& key_out) {
    if (ip.size() < 20 || (static_cast<unsigned char>(ip[0]) >> 4) != 4) return std::nullopt;
    const std::size_t header = (static_cast<unsigned char>(ip[0]) & 15U) * 4U;
    std::size_t total = big16(ip, 2);
    if (total == 0) total = ip.size();  // the network card was to fill it in
    if (header < 20 || total < header || ip[9] != 17) return std::nullopt;
    if (total > ip.size()) {
      ++cut_off;
      return std::nullopt;
    }
    const unsigned flags = big16(ip, 6);
    const std::size_t offset = (flags & 0x1fffU) * 8U;
    const bool more = (flags & 0x2000U) != 0;
    const std::string_view data = ip.substr(header, total - header);
    key_out = key;
    if (offset == 0 && !more) return data;
    if (offset + data.size() > 65535) return std::nullopt;
    const std::string id = std::string(ip.substr(4, 2)) + std::string(ip.substr(12, 8));
    auto it = std::find_if(pending_.begin(), pending_.end(), [&](const Pending& p) { return p.id == id; });
    if (it == pending_.end()) {
      if (pending_.size() == kMostPending) {
        pending_.pop_front();
        ++cut_off;
      }
      pending_.push_back({id, key, 0, {}, {}});
      it = pending_.end() - 1;
    }
    if (it->bytes.size() < offset + data.size()) it->bytes.resize(offset + data.size());
    std::copy(data.begin(), data.end(), it->bytes.begin() + static_cast<std::ptrdiff_t>(offset));
    if (it->parts.size() < 4096) it->parts.emplace_back(offset, offset + data.size());
    if (!more) it->size = offset + data.size();
    if (!it->is_whole()) return std::nullopt;
    key_out = it->key;
    joined_ = std::move(it->bytes);
    joined_.resize(it->size);
    pending_.erase(it);
    return joined_;
  }
  bool waits_for(std::uint64_t last) const {
    return std::any_of(pending_.begin(), pending_.end(), [&](const Pending& p) { return p.key <= last; });
  }

  std::uint64_t cut_off = 0;

 private:
  std::deque<Pending> pending_;
  std::string joined_;
};

}  // namespace

struct Capture::Impl {
  std::string path;
  pcap_t* file = nullptr;
  off_t start = 0;  ///< Of the first record.
  int link_type = 0;
  mutable std::mutex mutex;
  mutable std::string damage;
  mutable std::uint64_t cut_off = 0;
  ~Impl() {
    if (file) ::pcap_close(file);
  }
};

Capture::Capture(const std::string& path) : impl_(std::make_unique<Impl>()) {
  char error[PCAP_ERRBUF_SIZE] = "";
  impl_->path = path;
  impl_->file = ::pcap_open_offline(path.c_str(), error);
  if (!impl_->file)
    throw Error("the capture cannot be read (" + std::string(error) + ")", path,
                "It must be a .pcap or .pcapng file, as tcpdump and Wireshark write them.");
  impl_->link_type = ::pcap_datalink(impl_->file);
  impl_->start = ::ftello(::pcap_file(impl_->file));
}

Capture::~Capture() = default;

void Capture::read(std::uint64_t first, std::uint64_t last,
                   const std::function<bool(const Datagram&)>& use) const {
  const std::lock_guard lock(impl_->mutex);
  std::FILE* const stream = ::pcap_file(impl_->file);
  const auto from = std::max<std::uint64_t>(first, static_cast<std::uint64_t>(impl_->start));
  if (::fseeko(stream, static_cast<off_t>(from), SEEK_SET) != 0) return;
  Joiner joiner;
  std::uint64_t beyond = 0;
  while (true) {
    const auto at = static_cast<std::uint64_t>(::ftello(stream));
    if (at > last && (!joiner.waits_for(last) || ++beyond > kSearchedOn)) break;
    pcap_pkthdr* header = nullptr;
    const u_char* data = nullptr;
    const int code = ::pcap_next_ex(impl_->file, &header, &data);
    if (code == PCAP_ERROR_BREAK) break;  // the end
    if (code != 1) {
      impl_->damage =
          "is damaged or ends early at byte " + std::to_string(at) + " (" + ::pcap_geterr(impl_->file) + ")";
      break;
    }
    const auto ip = ip_packet({reinterpret_cast<const char*>(data), header->caplen}, impl_->link_type);
    if (!ip) continue;
    Datagram datagram;
    const auto udp = joiner.add(*ip, at, datagram.key);
    if (!udp || udp->size() < 8 || datagram.key < first || datagram.key > last) continue;
    const std::size_t length = big16(*udp, 4);
    if (length < 8 || length > udp->size()) continue;
    datagram.payload = udp->substr(8, length - 8);
    datagram.received_us =
        std::clamp<std::int64_t>(header->ts.tv_sec, 0, kMostReceived_us / 1'000'000) * 1'000'000 +
        std::clamp<std::int64_t>(header->ts.tv_usec, 0, 999'999);
    char address[INET_ADDRSTRLEN] = "";
    ::inet_ntop(AF_INET, ip->data() + 12, address, sizeof(address));
    datagram.source = std::string(address) + ":" + std::to_string(big16(*udp, 2));
    if (!use(datagram)) break;
  }
  if (last == UINT64_MAX) impl_->cut_off = joiner.cut_off;
}

std::string Capture::damage() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->damage;
}

std::uint64_t Capture::cut_off() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->cut_off;
}

}  // namespace hp2
