// Names of the LCM channels and topics, as lcmtypes/README.md lists them.
#pragma once
#include <string>

namespace hp2 {

inline constexpr const char* kScanChannel = "HP2_SCAN";
inline constexpr const char* kOdometryChannel = "HP2_ODOMETRY";
inline constexpr const char* kClosureChannel = "HP2_CLOSURE";
inline constexpr const char* kCorrectionChannel = "HP2_CORRECTION";
inline constexpr const char* kOfferChannel = "HP2_OFFER";
inline constexpr const char* kFetchChannel = "HP2_FETCH";
inline constexpr const char* kStatusChannel = "HP2_STATUS";
inline constexpr const char* kControlChannel = "HP2_CONTROL";

inline constexpr const char* kScanTopic = "SCAN";
inline constexpr const char* kSubmapTopic = "SUBMAP";
inline constexpr const char* kResumeTopic = "RESUME";
inline constexpr const char* kGraphTopic = "GRAPH";
inline constexpr const char* kTrajectoryTopic = "TRAJECTORY";
inline constexpr const char* kSessionSubmapTopic = "SESSION_SUBMAP";

/// Channel that carries the pieces of a topic's messages.
inline std::string chunk_channel(const std::string& topic) { return "HP2_CHUNK_" + topic; }

}  // namespace hp2
