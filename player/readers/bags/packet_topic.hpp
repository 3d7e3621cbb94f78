// A topic of LiDAR packets as a drive.
#pragma once
#include <memory>
#include <string>

#include "player/readers/bags/recording.hpp"
#include "player/readers/drive.hpp"

namespace hp2 {

/// Recognises the sensor by its packets and sets the drive's scans, decoder and warnings; `frame` becomes the
/// frame of the messages, where they name one. An Ouster's metadata are taken from a topic of the recording
/// (std_msgs/String), or from a JSON file beside it.
/// @param metadata name of a file with an Ouster's metadata; "": find them
/// @throws Error if the sensor is not known, its metadata are missing, or no turn is whole
void set_packet_topic_scans(std::shared_ptr<const Recording> recording, const BagTopic& topic,
                            const std::string& metadata, Drive& drive, std::string& frame);

}  // namespace hp2
