#include "common/session/session_records.hpp"

#include <cstring>

#include "common/session/damage.hpp"
#include "common/session/submap_codec.hpp"

namespace hp2 {

std::vector<std::uint8_t> encode_closure(const ClosureRecord& c) {
  BlobWriter out;
  out.put_pose(c.from_from_to);
  out.put_matrix(c.information);
  out.put(c.from_submap);
  out.put(c.to_submap);
  out.put(static_cast<std::int32_t>(c.inliers));
  out.put(c.overlap);
  out.put(c.residual_m);
  out.put(static_cast<std::uint8_t>(c.accepted));
  out.put_text(c.reason);
  return out.finish();
}

void decode_closure(const std::vector<std::uint8_t>& bytes, const std::string& where, ClosureRecord& c) {
  BlobReader in(bytes, where);
  c.from_from_to = in.get_pose();
  c.information = in.get_matrix();
  if (in.left() == 0) return;
  c.from_submap = in.get<std::int64_t>();
  c.to_submap = in.get<std::int64_t>();
  c.inliers = in.get<std::int32_t>();
  c.overlap = in.get<double>();
  c.residual_m = in.get<double>();
  c.accepted = in.get<std::uint8_t>() != 0;
  c.reason = in.get_text();
}

std::vector<std::uint8_t> encode_edge(const GraphEdge& edge) {
  BlobWriter out;
  out.put_pose(edge.from_from_to);
  out.put_matrix(edge.information);
  return out.finish();
}

GraphEdge decode_edge(const std::vector<std::uint8_t>& bytes, const std::string& where, std::size_t from) {
  BlobReader in(bytes, where);
  GraphEdge edge;
  edge.from = from;
  edge.to = from + 1;
  edge.from_from_to = in.get_pose();
  edge.information = in.get_matrix();
  return edge;
}

std::vector<std::uint8_t> encode_pose_with(const Pose& pose, double real, std::int64_t number) {
  BlobWriter out;
  out.put(std::uint64_t{1});
  out.put_pose(pose);
  out.put(real);
  out.put(number);
  return out.finish();
}

Pose decode_pose_with(const std::vector<std::uint8_t>& bytes, const std::string& where, double& real,
                      std::int64_t& number) {
  BlobReader in(bytes, where);
  if (in.get<std::uint64_t>() != 1) throw damage("a pose is missing", where);
  const Pose pose = in.get_pose();
  if (in.left() == 0) return pose;
  real = in.get<double>();
  number = in.get<std::int64_t>();
  return pose;
}

std::vector<std::uint8_t> encode_frontend_state(const std::vector<std::uint8_t>& state, bool last) {
  BlobWriter out;
  out.put(static_cast<std::uint8_t>(last));
  if (!state.empty()) std::memcpy(out.room(state.size()), state.data(), state.size());
  return out.finish();
}

std::pair<std::vector<std::uint8_t>, bool> decode_frontend_state(const std::vector<std::uint8_t>& bytes,
                                                                 const std::string& where) {
  BlobReader in(bytes, where);
  const bool last = in.get<std::uint8_t>() != 0;
  const std::size_t n = in.left();
  const std::uint8_t* p = in.skip(n);
  return {std::vector<std::uint8_t>(p, p + n), last};
}

}  // namespace hp2
