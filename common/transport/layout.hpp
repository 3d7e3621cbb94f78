// Checks bytes from the network against the layout of a message type before they are decoded. The decoders
// that lcm-gen makes trust the counts in a message: they allocate first and look at the length afterwards.
#pragma once
#include <cstddef>
#include <cstdint>
#include <hp2/chunk_t.hpp>
#include <hp2/closure_t.hpp>
#include <hp2/control_t.hpp>
#include <hp2/correction_t.hpp>
#include <hp2/fetch_t.hpp>
#include <hp2/graph_t.hpp>
#include <hp2/odometry_t.hpp>
#include <hp2/offer_t.hpp>
#include <hp2/resume_t.hpp>
#include <hp2/scan_t.hpp>
#include <hp2/status_t.hpp>
#include <hp2/submap_t.hpp>
#include <hp2/trajectory_t.hpp>

namespace hp2 {

/// Walks over the encoded fields of a message, never past its end. After the first field that does not fit,
/// ok() is false and everything else does nothing.
class LayoutWalker {
 public:
  LayoutWalker(const std::uint8_t* data, std::size_t size) : data_(data), left_(size) {}

  void skip(std::size_t bytes);
  /// A count: not negative, and `bytes_each` times it must be left in the message after it.
  std::size_t count(std::size_t bytes_each);
  /// A count without a look at what follows.
  std::size_t count();
  /// A string: its length, its characters, a zero.
  void string();
  bool ok() const { return ok_; }
  bool at_end() const { return ok_ && left_ == 0; }
  /// The first byte that was not walked over.
  const std::uint8_t* position() const { return data_; }

 private:
  const std::uint8_t* data_;
  std::size_t left_;
  bool ok_ = true;
};

/// Walks over one message of each type, without its fingerprint.
void walk(LayoutWalker& w, const chunk_t*);
void walk(LayoutWalker& w, const closure_t*);
void walk(LayoutWalker& w, const control_t*);
void walk(LayoutWalker& w, const correction_t*);
void walk(LayoutWalker& w, const fetch_t*);
void walk(LayoutWalker& w, const graph_t*);
void walk(LayoutWalker& w, const odometry_t*);
void walk(LayoutWalker& w, const offer_t*);
void walk(LayoutWalker& w, const resume_t*);
void walk(LayoutWalker& w, const scan_t*);
void walk(LayoutWalker& w, const status_t*);
void walk(LayoutWalker& w, const submap_t*);
void walk(LayoutWalker& w, const trajectory_t*);

/// Walks over scan_t up to the number of points.
void walk_before_points(LayoutWalker& w);

/// Whether untrusted bytes are one message of type T: its fingerprint, counts that fit the bytes, no byte
/// missing and none left over.
template <class T>
bool has_layout(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
  if (size < 8 || size > kMaxBytes) return false;
  std::uint64_t fingerprint = 0;
  for (int i = 0; i < 8; ++i) fingerprint = fingerprint << 8U | data[i];
  if (fingerprint != static_cast<std::uint64_t>(T::getHash())) return false;
  LayoutWalker w(data + 8, size - 8);
  walk(w, static_cast<const T*>(nullptr));
  return w.at_end();
}

/// Decodes a message from untrusted bytes. Allocates no more than a small multiple of `size`.
/// @return false, with `message` unspecified, if the bytes do not have the type's layout
template <class T>
bool safe_decode(const std::uint8_t* data, std::size_t size, T& message) {
  return has_layout<T>(data, size) &&
         message.decode(data, 0, static_cast<int>(size)) == static_cast<int>(size);
}

}  // namespace hp2
