// Which reading of a sweep fits the scans: readings are tried on stretches of a drive and compared scan by
// scan.
#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "player/sweep/sweep_reading.hpp"
#include "player/sweep/sweep_trial.hpp"

namespace hp2 {

/// How much higher the costs of a trial are than those of another one, on the same scans.
struct CostDifference {
  double mean = 0.0;
  double deviations = 0.0;  ///< The mean over its standard deviation.
};
CostDifference compare_costs(const std::vector<double>& worse, const std::vector<double>& better);

/// A trial's costs but for the first scans, when the map holds too little yet.
std::vector<double> settled_costs(const TrialResult& result);

/// Compares readings; the first one is what holds if none is clearly best.
class SweepComparison {
 public:
  /// @param sweep_s duration of a sweep [s]
  /// @param scale   of the scene, see scale_of_scene()
  SweepComparison(const std::vector<SweepReading>& readings, double sweep_s, double scale);

  /// Tries all readings that are still likely on scans that follow one another.
  /// @return false if the sensor hardly moved: the stretch tells nothing and is not counted
  bool add_stretch(const std::vector<TrialScan>& scans);

  /// How clearly a reading must be better than every other one.
  struct Demand {
    double deviations = 3.0;  ///< Mean difference of the costs over its standard deviation.
    double share = 0.005;     ///< Mean difference of the costs over the cost.
  };
  /// The reading that is clearly best; nothing if none is.
  std::optional<SweepReading> best(const Demand& demand) const;

  /// True if the first reading is the best one, however little.
  bool first_leads() const { return scans_ > 0 && best_candidate() == 0; }
  /// The reading that is best, however little; only after a stretch.
  const SweepReading& leader() const { return candidates_[best_candidate()].reading; }
  double scale() const { return scale_; }
  /// Differences to the best one, for the log.
  std::string to_text() const;

 private:
  struct Candidate {
    SweepReading reading;
    std::vector<double> costs, half_costs;  // half: with half of the motion undone
    bool dropped = false;
  };
  std::size_t best_candidate() const;
  bool motion_fits(const Candidate& best) const;

  std::vector<Candidate> candidates_;
  std::vector<double> undistorted_costs_;
  double sweep_s_, scale_;
  std::size_t scans_ = 0;
};

}  // namespace hp2
