// When the scans of a topic began, and what the times of their points mean.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "common/scan.hpp"
#include "player/readers/bags/recording.hpp"
#include "player/sweep/clock.hpp"

namespace hp2 {

/// A cloud in order of time.
struct TimedCloud {
  MessageRef ref;
  std::int64_t utime = 0;    ///< Start of the sweep [us].
  std::uint32_t layout = 0;  ///< Which of TimedClouds::units its times have.
  double raw_start = 0.0;    ///< Absolute times: the sweep's start in their own unit.
};

/// The clouds of a topic, those that were recorded twice left out.
struct TimedClouds {
  std::vector<TimedCloud> scans;
  std::vector<TimeUnit> units;  ///< One per layout of points: several sensors may share a topic.
  std::vector<bool> absolute;   ///< Per layout: the points' times are instants, not times in the sweep.
  std::string time_in_sweep;    ///< Their meaning, for people; "" if there are none.
  std::string frame;            ///< Frame of the first cloud.
};

/// Reads what is needed of the topic's messages. Where the points' times are instants, the sweeps begin with
/// their points, not with the headers' stamps; those follow the host's clock and the driver's habits.
/// @throws Error if no cloud is left
TimedClouds time_clouds(const Recording& recording, const BagTopic& topic,
                        std::vector<std::string>& warnings);

/// Sets scan.time from the points' raw times; leaves it empty where they are of no use.
void apply_cloud_times(const TimedClouds& clouds, const TimedCloud& cloud, std::vector<double>& raw,
                       Scan& scan);

}  // namespace hp2
