// Limits of messages, in one place. Senders check them with an error; receivers refuse larger
// messages.
#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

#include "common/scan.hpp"

namespace hp2 {

/// Most points of a scan; more are an error.
inline constexpr std::size_t kMaxScanPoints = 4'000'000;
/// Longest sweep [us].
inline constexpr std::int64_t kLongestSweepUs = 60'000'000;
/// Most bytes of an encoded scan: x, y, z, intensity and time of every point, and what comes before them.
inline constexpr std::size_t kMaxScanBytes = kMaxScanPoints * 5 * sizeof(float) + (std::size_t{1} << 20U);
/// Most bytes of any message that goes in pieces.
inline constexpr std::size_t kMaxMessageBytes = std::size_t{256} << 20U;
static_assert(kMaxScanBytes <= kMaxMessageBytes);

/// To be called before a scan is sent.
/// @param where the scan, e.g. the drive and the scan's number
/// @throws Error that names the scan and the limit it is beyond
void check_scan_limits(const Scan& scan, const std::string& where);

}  // namespace hp2
