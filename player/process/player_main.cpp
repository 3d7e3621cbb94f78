// hp2_player: plays a logged or synthetic drive to the front-end.
#include <cstdio>
#include <map>
#include <string>

#include <CLI/CLI.hpp>

#include "common/error.hpp"
#include "common/evaluation/trajectory.hpp"
#include "common/program.hpp"
#include "common/transport/lcm_bus.hpp"
#include "common/transport/process.hpp"
#include "player/process/drive_info.hpp"
#include "player/process/player_process.hpp"
#include "player/scan_source.hpp"

namespace {

double parse_rate(const std::string& text) {
  if (text == "max") return 0.0;
  std::size_t used = 0;
  double rate = 0.0;
  try {
    rate = std::stod(text, &used);
  } catch (const std::exception&) {
    used = 0;
  }
  if (used == 0 || used != text.size() || !(rate > 0.0 && rate < 1e6)) {
    throw hp2::Error("the rate \"" + text + "\" is not understood", "--rate",
                     "Write max, or how many times real time, e.g. 1 or 2.5.");
  }
  return rate;
}

void write_ground_truth(const hp2::ScanSource& source, const std::string& path) {
  hp2::Trajectory truth;
  for (const hp2::StampedPose& p : source.ground_truth()) {
    truth.times_s.push_back(1e-6 * static_cast<double>(p.utime));
    truth.poses.push_back(Eigen::Matrix4d::Identity());
    truth.poses.back().topRows<3>() = p.pose.matrix();
  }
  if (truth.poses.empty()) {
    throw hp2::Error("the drive has no ground truth", source.info().path,
                     "README.md, \"Data sets\", says where each format has it.");
  }
  hp2::write_trajectory(path, truth, hp2::TrajectoryFormat::kTum);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Plays a LiDAR drive to the front-end over LCM.", "hp2_player");
  std::string data, rate = "max", ground_truth;
  bool info = false;
  hp2::SourceOptions source_options;
  hp2::PlayerOptions options;
  hp2::CommonOptions common;
  app.add_option("DATA", data, "Folder of the drive (its format is recognised), or synthetic:SCENE[:SEED]")
      ->required();
  app.add_option("--dataset", source_options.dataset, "Format of the drive, if it is not to be recognised")
      ->type_name("NAME");
  app.add_option(
         "--rate", rate,
         "max: lockstep, every scan is registered, as fast as that goes; or times real time by the recorded "
         "clock, where scans are skipped if the front-end does not keep up")
      ->type_name("R|max")
      ->capture_default_str();
  app.add_option("--first", source_options.first, "Skip so many scans")->type_name("N");
  app.add_option("--count", source_options.count, "Play at most so many scans; 0: all")->type_name("N");
  app.add_option("--stride", source_options.stride, "Play every N-th scan")
      ->type_name("N")
      ->check(CLI::Range(std::size_t{1}, std::size_t{1000000}));
  app.add_option("--topic", source_options.topic,
                 "Topic of a bag, channel of a log, or sender's address in a packet capture")
      ->type_name("NAME");
  app.add_option("--bin-layout", source_options.bin_layout,
                 "Records of .bin scans, if they are not to be recognised: xyzi, xyz, xyzir, xyzit, xyzirt, "
                 "xyz-double, xyzi-double, nclt")
      ->type_name("NAME");
  app.add_option("--metadata", source_options.metadata,
                 "Ouster's metadata JSON of a packet capture, if it does not lie beside it")
      ->type_name("FILE");
  app.add_option("--ground-truth-topic", source_options.ground_truth_topic,
                 "Topic of a bag with the poses to compare with (Odometry, PoseStamped, NavSatFix)")
      ->type_name("NAME");
  app.add_option(
         "--sweep", source_options.sweep,
         "How the points lie in the sweep: auto (as the scans agree best), given (as the file says), "
         "compensated, reversed, clockwise[:DEG], counterclockwise[:DEG] (azimuth where a sweep begins)")
      ->type_name("NAME")
      ->capture_default_str();
  app.add_option(
         "--vertical-correction", source_options.kitti_correction,
         "Raise the vertical angles by 0.205 degrees, as KITTI's HDL-64E needs it: auto (if the scans "
         "are KITTI's), on, off")
      ->type_name("auto|on|off")
      ->transform(CLI::Transformer(std::map<std::string, int>{{"auto", -1}, {"on", 1}, {"off", 0}}));
  app.add_option("--times-unit", source_options.times_unit, "Unit of the scans' times: s, ms, us or ns")
      ->type_name("UNIT");
  app.add_option("--points-unit", source_options.points_unit, "Unit of the points: m, cm or mm")
      ->type_name("UNIT");
  app.add_flag("--skip-damaged", source_options.skip_damaged,
               "Go on where a scan cannot be read: it is left out, counted and reported");
  app.add_option("--write-ground-truth", ground_truth,
                 "Play nothing: write the drive's ground truth for hp2_eval (TUM format, LiDAR's frame, end "
                 "of each sweep)")
      ->type_name("FILE");
  app.add_flag("--info", info,
               "Say what the drive is, what its scans hold and what is wrong with them, and exit");
  app.add_flag("--start-paused", options.start_paused,
               "Wait for hp2_control resume (or step) before the first scan");
  app.add_option("--threads", options.threads, "Threads that read ahead")
      ->type_name("N")
      ->check(CLI::Range(1, 16))
      ->capture_default_str();
  hp2::add_run_options(app, options.run);
  hp2::add_common_options(app, common, false);
  app.add_option("--config", common.config_path,
                 "The front-end's YAML file: where its section \"sensor\" corrects the vertical angles, they "
                 "are not raised here as well")
      ->type_name("FILE");
  app.footer(
      "Examples:\n"
      "  hp2_player synthetic:loop                    a made drive in lockstep\n"
      "  hp2_player ~/kitti/sequences/07 --rate 1     by the recorded clock\n"
      "  hp2_player DATA --first 100 --count 50 --start-paused\n"
      "It waits for a front-end, resumes at the scan that the front-end wants next, and ends when all scans "
      "are stored.");
  CLI11_PARSE(app, argc, argv);
  return hp2::run_program("hp2_player", [&] {
    hp2::SensorCalibration sensor;
    hp2::Config config;
    config.add(hp2::sensor_section(sensor));
    hp2::apply_common_options(common, &config);
    hp2::leave_angles_to(sensor, source_options);
    options.rate = parse_rate(rate);
    const auto source = hp2::open_source(data, source_options);
    if (!ground_truth.empty()) {
      write_ground_truth(*source, ground_truth);
      return 0;
    }
    if (info) {
      std::fputs(hp2::describe_drive(*source).c_str(), stdout);
      return 0;
    }
    hp2::catch_stop_signals();
    hp2::LcmBus bus(common.lcm_url);
    hp2::PlayerProcess player(bus, *source, options);
    bus.run([&] { return player.tick(); });
    return player.exit_status();
  });
}
