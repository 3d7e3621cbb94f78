#include "common/transport/datagram_filter.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

#include <gtest/gtest.h>

namespace hp2 {
namespace {

std::string big_endian(std::uint64_t value, int bytes) {
  std::string s;
  for (int k = bytes - 1; k >= 0; --k) s.push_back(static_cast<char>(value >> (8 * k) & 0xffU));
  return s;
}

std::string fragment(std::uint64_t size, std::uint64_t offset, std::uint64_t number,
                     const std::string& rest) {
  return "LC03" + big_endian(7, 4) + big_endian(size, 4) + big_endian(offset, 4) + big_endian(number, 2) +
         big_endian(3, 2) + rest;
}

// A socket that receives on the loopback device, as LCM's does from its group.
class DatagramFilterTest : public ::testing::Test {
 protected:
  DatagramFilterTest()
      : receiver_(::socket(AF_INET, SOCK_DGRAM, 0)), sender_(::socket(AF_INET, SOCK_DGRAM, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address_;
    EXPECT_EQ(::bind(receiver_, reinterpret_cast<sockaddr*>(&address_), size), 0);
    EXPECT_EQ(::getsockname(receiver_, reinterpret_cast<sockaddr*>(&address_), &size), 0);
    EXPECT_TRUE(filter_.attach(url()));
  }
  ~DatagramFilterTest() override {
    ::close(receiver_);
    ::close(sender_);
  }
  std::string url() const {
    return "udpm://239.255.76.67:" + std::to_string(ntohs(address_.sin_port)) + "?ttl=0";
  }
  bool passes(const std::string& datagram) {
    ::sendto(sender_, datagram.data(), datagram.size(), 0, reinterpret_cast<sockaddr*>(&address_),
             sizeof address_);
    std::string got(70000, '\0');
    const ssize_t n = ::recv(receiver_, got.data(), got.size(), MSG_DONTWAIT);
    if (n >= 0) {
      got.resize(static_cast<std::size_t>(n));
      EXPECT_EQ(got, datagram);
    }
    return n >= 0;
  }

  int receiver_, sender_;
  sockaddr_in address_{};
  DatagramFilter filter_;
};

TEST_F(DatagramFilterTest, PassesWhatLcmSends) {
  const std::string zero(1, '\0');
  EXPECT_TRUE(passes("LC02" + big_endian(1, 4) + "HP2_SCAN" + zero + "data"));
  EXPECT_TRUE(passes("LC02" + big_endian(1, 4) + std::string(63, 'c') + zero));
  EXPECT_TRUE(passes("LC02" + big_endian(1, 4) + "C" + zero + std::string(60000, 'x')));
  EXPECT_TRUE(passes(fragment(100'000, 0, 0, "HP2_SCAN" + zero + std::string(50000, 'x'))));
  EXPECT_TRUE(passes(fragment(100'000, 50'000, 1, std::string(50000, 'x'))));
  EXPECT_EQ(filter_.dropped(), 0);
}

TEST_F(DatagramFilterTest, DropsAndCountsWhatItsReceiverWouldDieOf) {
  const std::string zero(1, '\0');
  EXPECT_FALSE(passes(""));
  EXPECT_FALSE(passes("LC0"));
  EXPECT_FALSE(passes("LC01" + big_endian(1, 4) + "HP2_SCAN" + zero));
  EXPECT_FALSE(passes("LC02" + big_endian(1, 4)));
  EXPECT_FALSE(passes("LC02" + big_endian(1, 4) + "HP2_SCAN"));
  EXPECT_FALSE(passes("LC02" + big_endian(1, 4) + std::string(64, 'c') + zero + "data"));
  EXPECT_FALSE(passes(fragment(1000, 0, 0, "HP2_SCAN")));
  EXPECT_FALSE(passes(fragment(1000, 1001, 1, "data")));
  EXPECT_FALSE(passes(fragment(1000, 0xffffffff, 1, "data")));
  EXPECT_FALSE(passes(fragment(0xffffffff, 0, 0, "HP2_SCAN" + zero + "data")));
  EXPECT_FALSE(passes(fragment(1000, 0, 1, "").substr(0, 19)));
  EXPECT_EQ(filter_.dropped(), 11);
}

TEST_F(DatagramFilterTest, KeepsUnwantedChannelsAway) {
  const std::string zero(1, '\0');
  WantedMessages wanted;
  wanted.channels = {"HP2_OFFER", "HP2_CHUNK_SUBMAP", "C"};
  ASSERT_TRUE(filter_.attach(url(), wanted));
  const auto on = [&](const std::string& channel) { return "LC02" + big_endian(1, 4) + channel + zero; };
  EXPECT_TRUE(passes(on("HP2_OFFER") + "data"));
  EXPECT_TRUE(passes(on("HP2_OFFER")));
  EXPECT_TRUE(passes(on("HP2_CHUNK_SUBMAP") + std::string(60000, 'x')));
  EXPECT_TRUE(passes(on("C")));
  EXPECT_TRUE(passes(fragment(100'000, 0, 0, "HP2_SCAN" + zero + std::string(50000, 'x'))));
  EXPECT_TRUE(passes(fragment(100'000, 50'000, 1, std::string(50000, 'x'))));
  EXPECT_EQ(filter_.dropped(), 0);
  EXPECT_FALSE(passes(on("HP2_CHUNK_SCAN") + std::string(60000, 'x')));
  EXPECT_FALSE(passes(on("HP2_CHUNK_SUBMAP2") + "data"));
  EXPECT_FALSE(passes(on("HP2_CHUNK_SUBMA") + "data"));
  EXPECT_FALSE(passes(on("D")));
  EXPECT_FALSE(passes(on("")));
  EXPECT_FALSE(passes("LC02" + big_endian(1, 4) + "HP2_OFFER"));
  EXPECT_FALSE(passes("LC02" + big_endian(1, 4)));
  EXPECT_FALSE(passes("LC01" + big_endian(1, 4) + "HP2_OFFER" + zero));
  EXPECT_FALSE(passes(fragment(1000, 1001, 1, "data")));
  EXPECT_EQ(filter_.dropped(), 9);
}

TEST_F(DatagramFilterTest, KeepsMessagesForOthersAway) {
  const std::string zero(1, '\0');
  constexpr std::uint64_t kType = 0x89ab'cdef'0123'4567, kMine = 0x0123'4567'89ab'cdef;
  WantedMessages wanted;
  wanted.channels = {"HP2_OFFER", "HP2_FETCH", "HP2_STATUS"};
  wanted.addressed = {"HP2_FETCH", kType, 24, static_cast<std::int64_t>(kMine)};
  ASSERT_TRUE(filter_.attach(url(), wanted));
  const auto message = [&](std::uint64_t type, std::uint64_t address) {
    return big_endian(type, 8) + std::string(16, 'x') + big_endian(address, 8);
  };
  const auto on = [&](const std::string& channel) { return "LC02" + big_endian(1, 4) + channel + zero; };
  EXPECT_TRUE(passes(on("HP2_FETCH") + message(kType, kMine)));
  EXPECT_TRUE(passes(on("HP2_FETCH") + message(kType, kMine) + "more"));
  EXPECT_FALSE(passes(on("HP2_FETCH") + message(kType, kMine + 1) + "more"));
  EXPECT_FALSE(passes(on("HP2_FETCH") + message(kType, kMine + (std::uint64_t{1} << 40U))));
  EXPECT_EQ(filter_.dropped(), 2);
  // Nobody's: the process says what is wrong with it.
  EXPECT_TRUE(passes(on("HP2_FETCH") + message(kType + 1, kMine + 1)));
  EXPECT_TRUE(passes(on("HP2_FETCH") + message(kType, kMine + 1).substr(0, 31)));
  EXPECT_TRUE(passes(on("HP2_FETCH")));
  EXPECT_TRUE(passes(on("HP2_STATUS") + message(kType, kMine + 1)));
  EXPECT_FALSE(passes(on("HP2_CONTROL") + message(kType, kMine)));
}

TEST(DatagramFilter, SaysWhenThereIsNoSocket) {
  DatagramFilter filter;
  EXPECT_FALSE(filter.attach("udpm://239.255.76.67:1?ttl=0"));
  EXPECT_FALSE(filter.attach("file:///tmp/log.lcm"));
  EXPECT_EQ(filter.dropped(), 0);
}

}  // namespace
}  // namespace hp2
