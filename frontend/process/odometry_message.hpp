// The front-end's output per scan, as odometry_t.
#pragma once
#include <hp2/odometry_t.hpp>

#include "frontend/frontend.hpp"

namespace hp2 {

/// All but the session, the sender and the number of the message.
odometry_t to_message(const OdometryResult& result, std::int64_t session_id, std::int64_t sender_id,
                      std::int64_t number);

}  // namespace hp2
