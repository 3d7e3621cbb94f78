#include "player/readers/drive.hpp"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "common/error.hpp"

namespace hp2 {
namespace {

class DriveSource final : public ScanSource {
 public:
  DriveSource(Drive drive, const SourceOptions& options)
      : drive_(std::move(drive)), skip_damaged_(options.skip_damaged) {
    const std::size_t stride = std::max<std::size_t>(options.stride, 1);
    for (std::size_t i = options.first; i < drive_.scans.size(); i += std::min(stride, drive_.scans.size())) {
      if (options.count > 0 && selected_.size() == options.count) break;
      selected_.push_back(i);
      if (i < drive_.ground_truth.size() && drive_.ground_truth[i])
        ground_truth_.push_back({drive_.scans[i].utime_end(), *drive_.ground_truth[i]});
    }
    if (selected_.empty())
      throw Error("no scan is left", drive_.info.name,
                  "The drive has " + std::to_string(drive_.scans.size()) + " scans; --first skips " +
                      std::to_string(options.first) + " of them.");
  }

  const SourceInfo& info() const override { return drive_.info; }
  std::size_t size() const override { return selected_.size(); }
  const std::vector<StampedPose>& ground_truth() const override { return ground_truth_; }
  std::vector<std::string> warnings() const override { return drive_.warnings; }
  std::optional<std::int64_t> utime_end(std::size_t index) const override {
    return drive_.scans[selected_.at(index)].utime_end();
  }

  using ScanSource::read;
  Scan read(std::size_t index, Scan used_up) const override {
    if (index >= selected_.size())
      throw Error("there is no scan " + std::to_string(index), drive_.info.name,
                  "The drive has " + std::to_string(selected_.size()) + " scans.");
    const DriveScan& entry = drive_.scans[selected_[index]];
    Scan scan = std::move(used_up);
    scan.time.clear();
    scan.sequence = static_cast<std::int64_t>(index);
    scan.utime = entry.utime;
    scan.duration_us = entry.duration_us;
    scan.sensor = drive_.info.sensor;
    try {
      drive_.decode(entry, scan);
    } catch (const Error& error) {
      if (!skip_damaged_) throw;
      leave_out(index, error, scan);
    }
    return scan;
  }

  std::string time_in_sweep() const override { return drive_.time_in_sweep; }
  std::string sweep() const override { return drive_.sweep; }
  std::vector<std::string> damaged() const override {
    const std::lock_guard<std::mutex> lock(mutex_);
    std::vector<std::string> texts;
    for (const auto& [index, text] : damaged_) texts.push_back(text);
    return texts;
  }

 private:
  void leave_out(std::size_t index, const Error& error, Scan& scan) const {
    for (auto* values : {&scan.x, &scan.y, &scan.z, &scan.intensity, &scan.time}) values->clear();
    const std::lock_guard<std::mutex> lock(mutex_);
    damaged_.emplace(index, "scan " + std::to_string(index) + " is left out: " + error.what());
  }

  Drive drive_;
  bool skip_damaged_;
  mutable std::mutex mutex_;
  mutable std::map<std::size_t, std::string> damaged_;  ///< Several threads read.
  std::vector<std::size_t> selected_;
  std::vector<StampedPose> ground_truth_;
};

}  // namespace

std::unique_ptr<ScanSource> make_source(Drive drive, const SourceOptions& options) {
  return std::make_unique<DriveSource>(std::move(drive), options);
}

}  // namespace hp2
