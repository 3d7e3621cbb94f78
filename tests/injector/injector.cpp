// A stand-alone sensor driver: knows LCM and the message types, nothing else of this project. Publishes scans
// that it makes up (or reads from .bin files) and prints the poses that come back.
//   hp2_injector [--url URL] [--scans N] [--rate HZ] [--points N] [--chunks] [--quiet] [FILE.bin ...]
// Without files it drives along a street, faster and faster up to 0.5 m a scan, with houses, posts and a wall
// across its end. A scan that is small goes out whole on HP2_SCAN, a large one (or every one, with --chunks)
// in pieces on HP2_CHUNK_SCAN.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <hp2/chunk_t.hpp>
#include <hp2/odometry_t.hpp>
#include <hp2/scan_t.hpp>
#include <random>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include <lcm/lcm-cpp.hpp>

namespace {

struct Options {
  std::string url = "udpm://239.255.76.67:7667?ttl=0";
  int scans = 100;
  double rate_hz = 10.0;
  int points = 6000;
  std::int64_t first_number = 0;
  bool chunks = false, quiet = false;
  std::vector<std::string> files;
};

// Distance from `origin` along `direction` to the nearest surface of the street: ground 1.7 m below the
// sensor, houses at both sides with gaps between them, round posts every 15 m, and a wall across the street's
// end at 120 m.
double cast(const double (&o)[3], const double (&d)[3]) {
  double nearest = 1e9;
  const auto hit = [&nearest](double t) {
    if (t > 0.5 && t < nearest) nearest = t;
  };
  if (d[2] < 0) hit((-1.7 - o[2]) / d[2]);
  for (int house = -8; house < 16; ++house) {  // each a box, 10 m along the street
    for (const double side : {-1.0, 1.0}) {
      const double front = side * (8.0 + 1.5 * ((house * 7 + (side > 0 ? 3 : 0)) % 3));
      const double along[2] = {10.0 * house + 2.0, 10.0 * house + 9.0};
      const double t = (front - o[1]) / d[1], x = o[0] + t * d[0];
      if (t > 0 && x > along[0] && x < along[1] && o[2] + t * d[2] < 6.0) hit(t);
      for (const double wall : along) {
        const double u = (wall - o[0]) / d[0], y = (o[1] + u * d[1]) * side;
        if (u > 0 && y > front * side && y < 20.0 && o[2] + u * d[2] < 6.0) hit(u);
      }
    }
  }
  const double end = (120.0 - o[0]) / d[0];
  if (end > 0 && o[2] + end * d[2] < 12.0) hit(end);
  for (int k = -8; k < 16; ++k) {
    const double px = 7.0 * k - o[0], py = (k % 2 == 0 ? 5.0 : -5.0) - o[1], r = 0.2;
    const double a = d[0] * d[0] + d[1] * d[1], b = d[0] * px + d[1] * py, c = px * px + py * py - r * r;
    const double disc = b * b - a * c;
    if (disc > 0) hit((b - std::sqrt(disc)) / a);
  }
  return nearest;
}

// Metres driven at the end of scan `index`: 0.02 m more each scan, until it is 0.5 m a scan.
double position(int index) {
  const double n = std::max(0, index), ramp = std::min(n, 25.0);
  return 0.01 * ramp * ramp + 0.5 * (n - ramp);
}

hp2::scan_t make_scan(int index, const Options& options) {
  static std::mt19937 rng(1);
  std::normal_distribution<double> noise(0.0, 0.01);
  hp2::scan_t scan;
  for (int i = 0; i < options.points; ++i) {
    const double s = (i + 0.5) / options.points;  // one turn of the sensor a sweep, 16 beams interleaved
    const double azimuth = -2.0 * M_PI * s, elevation = (-15.0 + 2.0 * (i % 16)) * M_PI / 180.0;
    const double direction[3] = {std::cos(elevation) * std::cos(azimuth),
                                 std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
    const double origin[3] = {position(index - 1) + s * (position(index) - position(index - 1)), 0.0, 0.0};
    const double range = cast(origin, direction) + noise(rng);
    if (range > 80.0) continue;
    scan.x.push_back(static_cast<float>(range * direction[0]));
    scan.y.push_back(static_cast<float>(range * direction[1]));
    scan.z.push_back(static_cast<float>(range * direction[2]));
    scan.time.push_back(static_cast<float>(s));
  }
  scan.n = static_cast<std::int32_t>(scan.x.size());
  scan.n_time = scan.n;
  scan.n_intensity = 0;
  scan.duration = 100000;
  return scan;
}

hp2::scan_t read_scan(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  hp2::scan_t scan;
  for (std::size_t at = 0; at + 16 <= bytes.size(); at += 16) {
    float p[4];
    std::memcpy(p, bytes.data() + at, 16);
    scan.x.push_back(p[0]);
    scan.y.push_back(p[1]);
    scan.z.push_back(p[2]);
    scan.intensity.push_back(p[3]);
  }
  scan.n = scan.n_intensity = static_cast<std::int32_t>(scan.x.size());
  scan.n_time = 0;
  scan.duration = 0;
  return scan;
}

// CRC-32 as in zlib and PNG, bit by bit.
std::uint32_t crc32(const std::vector<std::uint8_t>& bytes) {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const auto byte : bytes) {
    crc ^= byte;
    for (int k = 0; k < 8; ++k) crc = (crc >> 1U) ^ ((crc & 1U) != 0 ? 0xEDB88320U : 0U);
  }
  return ~crc;
}

void publish(lcm::LCM& lcm, const hp2::scan_t& scan, std::int64_t sender, bool chunks) {
  constexpr std::size_t kPiece = 60000;
  const auto size = static_cast<std::size_t>(scan.getEncodedSize());
  if (!chunks && size <= kPiece) {
    lcm.publish("HP2_SCAN", &scan);
    return;
  }
  std::vector<std::uint8_t> bytes(size);
  scan.encode(bytes.data(), 0, static_cast<int>(size));
  hp2::chunk_t chunk;
  chunk.session_id = 0;
  chunk.sender_id = sender;
  chunk.message_id = scan.sequence;
  chunk.count = static_cast<std::int32_t>((size + kPiece - 1) / kPiece);
  chunk.total_size = static_cast<std::int32_t>(size);
  chunk.crc32 = static_cast<std::int32_t>(crc32(bytes));
  for (chunk.index = 0; chunk.index < chunk.count; ++chunk.index) {
    const std::size_t begin = static_cast<std::size_t>(chunk.index) * kPiece;
    const std::size_t end = std::min(size, begin + kPiece);
    chunk.offset = static_cast<std::int32_t>(begin);
    chunk.size = static_cast<std::int32_t>(end - begin);
    chunk.data.assign(bytes.begin() + static_cast<std::ptrdiff_t>(begin),
                      bytes.begin() + static_cast<std::ptrdiff_t>(end));
    lcm.publish("HP2_CHUNK_SCAN", &chunk);
    std::this_thread::sleep_for(std::chrono::microseconds(300));
  }
}

struct Listener {
  bool quiet = false;
  std::set<std::int64_t> scans;  // that have a pose; the first ones are told it twice
  void on_odometry(const lcm::ReceiveBuffer*, const std::string&, const hp2::odometry_t* m) {
    scans.insert(m->sequence);
    const double* t = m->odom_from_sensor.translation;
    if (!quiet)
      std::printf("scan %ld at %.3f %.3f %.3f, state %d\n", static_cast<long>(m->sequence), t[0], t[1], t[2],
                  m->state);
    if (!quiet) std::fflush(stdout);
  }
};

void print_usage(std::FILE* to) {
  std::fputs(
      "usage: hp2_injector [options] [FILE.bin ...]\n"
      "Publishes scans as a sensor driver would, and prints the poses that come back.\n\n"
      "  --url URL    LCM network (default udpm://239.255.76.67:7667?ttl=0)\n"
      "  --scans N    scans to make up (default 100); with files: one a file\n"
      "  --rate HZ    scans a second (default 10)\n"
      "  --points N   points of a made-up scan (default 6000)\n"
      "  --number-from N  number of the first scan (default 0)\n"
      "  --chunks     every scan in pieces on HP2_CHUNK_SCAN; without, only one that is larger than 60,000 "
      "bytes\n"
      "  --quiet      no line a pose\n"
      "  FILE.bin     scans as float32 x y z intensity, instead of made-up ones\n"
      "Exit status: 0 if poses came back, 1 if none, 2 for a wrong command line.\n",
      to);
}

[[noreturn]] void wrong(const std::string& what) {
  std::fprintf(stderr, "hp2_injector: %s\n\n", what.c_str());
  print_usage(stderr);
  std::exit(2);
}

double number(const std::string& option, const std::string& text, double least) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  if (text.empty() || *end != '\0' || !(value >= least) || value > 1e9)
    wrong(option + " \"" + text + "\" is not a number from " + std::to_string(least) + " on");
  return value;
}

Options parse(int argc, char** argv) {
  Options o;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] {
      if (i + 1 >= argc) wrong(word + " needs a value");
      return std::string(argv[++i]);
    };
    if (word == "-h" || word == "--help") {
      print_usage(stdout);
      std::exit(0);
    }
    if (word == "--url")
      o.url = value();
    else if (word == "--scans")
      o.scans = static_cast<int>(number(word, value(), 1));
    else if (word == "--rate")
      o.rate_hz = number(word, value(), 0.001);
    else if (word == "--points")
      o.points = static_cast<int>(number(word, value(), 1));
    else if (word == "--number-from")
      o.first_number = static_cast<std::int64_t>(number(word, value(), 0));
    else if (word == "--chunks")
      o.chunks = true;
    else if (word == "--quiet")
      o.quiet = true;
    else if (word.rfind('-', 0) == 0)
      wrong("unknown option " + word);
    else
      o.files.push_back(word);
  }
  if (!o.files.empty()) o.scans = static_cast<int>(o.files.size());
  return o;
}

}  // namespace

int main(int argc, char** argv) {
  const Options options = parse(argc, argv);
  lcm::LCM lcm(options.url);
  if (!lcm.good()) {
    std::fprintf(stderr, "hp2_injector: LCM cannot be started with %s\n", options.url.c_str());
    return 1;
  }
  Listener listener;
  listener.quiet = options.quiet;
  if (lcm.subscribe("HP2_ODOMETRY", &Listener::on_odometry, &listener) == nullptr) return 1;
  const auto sender = static_cast<std::int64_t>(std::random_device{}()) + 1;
  const auto start = std::chrono::steady_clock::now();
  const std::int64_t epoch_us = std::chrono::duration_cast<std::chrono::microseconds>(
                                    std::chrono::system_clock::now().time_since_epoch())
                                    .count();
  for (int i = 0; i < options.scans; ++i) {
    hp2::scan_t scan =
        options.files.empty() ? make_scan(i, options) : read_scan(options.files[static_cast<std::size_t>(i)]);
    scan.utime = epoch_us + 100000LL * i;
    scan.sensor = "injector";
    scan.sequence = options.first_number + i;
    scan.session_id = 0;
    publish(lcm, scan, sender, options.chunks);
    const auto next = start + std::chrono::duration<double>((i + 1) / options.rate_hz);
    while (std::chrono::steady_clock::now() < next) lcm.handleTimeout(1);
  }
  for (int i = 0; i < 100 && static_cast<int>(listener.scans.size()) < options.scans; ++i)
    lcm.handleTimeout(20);
  std::printf("%d scans sent, %zu poses received, %.3f m driven\n", options.scans, listener.scans.size(),
              position(options.scans - 1));
  return listener.scans.empty() ? 1 : 0;
}
