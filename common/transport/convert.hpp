// Between the message types and the structs of the stages. Data from the network is checked here: numbers of
// entries that belong together, finite poses, unit quaternions, known states.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/session.hpp"
#include "common/submap.hpp"
#include "common/transport/bulk_codec.hpp"
#include "common/transport/byte_vector.hpp"
#include "common/transport/layout.hpp"

namespace hp2 {

/// The encoded bytes of any message type, with its fingerprint.
template <class T>
ByteVector encode_message(const T& message) {
  ByteVector bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

/// Unit quaternion to within 1e-3 and finite, with positions within 1e7 m; nothing otherwise.
std::optional<Pose> to_pose(const pose_t& message);
pose_t to_message(const Pose& pose);

/// A submap with what travels beside it.
struct SubmapPackage {
  Submap submap;
  std::vector<std::uint8_t> frontend_state;  ///< At the submap's end; empty: none.
  bool last = false;
};
ByteVector encode_submap(const SubmapPackage& package, std::int64_t session_id);
/// Normals are rounded to 1/127 on the way.
std::optional<SubmapPackage> decode_submap(const std::uint8_t* data, std::size_t size,
                                           std::int64_t session_id);

/// The graph without its trajectory, which has a message of its own.
ByteVector encode_graph(const GraphState& graph, std::int64_t session_id);
std::optional<GraphState> decode_graph(const std::uint8_t* data, std::size_t size, std::int64_t session_id);
ByteVector encode_trajectory(const GraphState& graph, std::int64_t session_id);
/// A trajectory and the revision of the graph that it belongs to.
struct TrajectoryAtRevision {
  std::int64_t revision = 0;
  std::vector<TrajectoryPose> trajectory;
};
std::optional<TrajectoryAtRevision> decode_trajectory(const std::uint8_t* data, std::size_t size,
                                                      std::int64_t session_id);
/// One verdict as HP2_CLOSURE carries it; `number` counts them in the session.
closure_t to_message(const ClosureRecord& closure, std::int64_t session_id, std::int64_t number);

}  // namespace hp2
