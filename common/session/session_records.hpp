// The small records of a session as bytes with a checksum: verdicts, edges, poses, the front-end's state.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "common/session.hpp"

namespace hp2 {

/// All of a verdict. Versions before 4 have only the pose and the information in it; the other members of
/// `closure` are not changed then.
std::vector<std::uint8_t> encode_closure(const ClosureRecord& closure);
/// @throws DamageError, as all of these
void decode_closure(const std::vector<std::uint8_t>& bytes, const std::string& where, ClosureRecord& closure);

/// An edge to the submap that follows.
std::vector<std::uint8_t> encode_edge(const GraphEdge& edge);
GraphEdge decode_edge(const std::vector<std::uint8_t>& bytes, const std::string& where, std::size_t from);

/// A pose and two numbers that belong to it; versions before 4 have the pose alone, and leave the numbers as
/// they are.
std::vector<std::uint8_t> encode_pose_with(const Pose& pose, double real, std::int64_t number);
Pose decode_pose_with(const std::vector<std::uint8_t>& bytes, const std::string& where, double& real,
                      std::int64_t& number);

/// The front-end's state, opaque, and whether the session ends with the submap that it is of.
std::vector<std::uint8_t> encode_frontend_state(const std::vector<std::uint8_t>& state, bool last);
std::pair<std::vector<std::uint8_t>, bool> decode_frontend_state(const std::vector<std::uint8_t>& bytes,
                                                                 const std::string& where);

}  // namespace hp2
