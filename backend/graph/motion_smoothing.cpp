#include "backend/graph/motion_smoothing.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include <Eigen/Cholesky>

namespace hp2 {
namespace {

constexpr std::size_t kFewest = 20;  // samples needed to separate noise from motion
// Range of the ratio of jerk to noise that is searched, in powers of ten: from a curve that follows only what
// lasts for ten samples to one that goes through every sample.
constexpr double kSmoothest = -6.0, kRoughest = 6.0, kCoarseStep = 1.5, kFineStep = 0.25;
// Noise and jerk change along a drive. They are found for kBlock samples at a time. The curves of two
// neighbouring blocks blend into one another over kBlend samples about the border.
constexpr std::size_t kBlock = 300, kBlend = 40;
// Between scans further apart than this a sensor may have moved to and fro: inertia gives no information.
constexpr double kInertia_s = 0.25;
constexpr double kLongestStep = 50.0;  // in median steps: beyond it samples are nearly independent

using Samples = std::vector<std::vector<double>>;  // [component][sample]

std::vector<double>::const_iterator at(const std::vector<double>& v, std::size_t i) {
  return v.begin() + static_cast<std::ptrdiff_t>(i);
}

using Matrix3 = Eigen::Matrix3d;
using Vector3 = Eigen::Vector3d;

// Position, velocity and acceleration move on by F(t), and jerk of unit density adds the covariance Q(t).
Matrix3 transition(double t) {
  Matrix3 f = Matrix3::Identity();
  f(0, 1) = f(1, 2) = t;
  f(0, 2) = 0.5 * t * t;
  return f;
}

Matrix3 jerk_information(double t) {
  const double t2 = t * t, t3 = t2 * t, t4 = t3 * t, t5 = t4 * t;
  Matrix3 m;
  m << 720.0 / t5, -360.0 / t4, 60.0 / t3, -360.0 / t4, 192.0 / t3, -36.0 / t2, 60.0 / t3, -36.0 / t2,
      9.0 / t;
  return m;
}

// The least-squares problem  sum (x_i - y_i)^2 + sum |s_{i+1} - F_i s_i|^2 / q  over the states s_i, of which
// x_i is the position: block tridiagonal, solved by elimination. Unknowns are the states' differences from
// samples and finite differences, so that large coordinates cost no digits.
class Problem {
 public:
  explicit Problem(const std::vector<double>& steps) {
    for (const double t : steps) {
      f_.push_back(transition(t));
      w_.push_back(jerk_information(t));
    }
  }

  // Eliminates for one ratio q; half the logarithm of the determinant comes with it.
  void factor(double q) {
    q_ = q;
    const std::size_t n = f_.size() + 1;
    pivots_.resize(n);
    eliminators_.resize(n);
    log_determinant_ = 0.0;
    Matrix3 d = Matrix3::Zero();
    for (std::size_t i = 0; i < n; ++i) {
      d(0, 0) += 1.0;
      if (i + 1 < n) d += f_[i].transpose() * w_[i] * f_[i] / q;
      pivots_[i].compute(d);
      log_determinant_ += pivots_[i].vectorD().cwiseAbs().array().log().sum();
      if (i + 1 == n) break;
      const Matrix3 below = -w_[i] * f_[i] / q;  // block (i + 1, i)
      eliminators_[i] = pivots_[i].solve(below.transpose()).transpose();
      d = w_[i] / q - eliminators_[i] * below.transpose();
      d = (0.5 * (d + d.transpose())).eval();
    }
  }

  // Smooths one component. @return the cost at the optimum
  double solve(const std::vector<double>& y, const std::vector<double>& steps, std::vector<double>& x) const {
    const std::size_t n = y.size();
    std::vector<Vector3> nominal(n), b(n, Vector3::Zero());
    for (std::size_t i = 0; i < n; ++i) nominal[i] = {y[i], 0.0, 0.0};
    for (std::size_t i = 1; i + 1 < n; ++i) {
      const double before = (y[i] - y[i - 1]) / steps[i - 1], after = (y[i + 1] - y[i]) / steps[i];
      nominal[i][1] = (before * steps[i] + after * steps[i - 1]) / (steps[i] + steps[i - 1]);
    }
    nominal[0][1] = (y[1] - y[0]) / steps[0];
    nominal[n - 1][1] = (y[n - 1] - y[n - 2]) / steps[n - 2];
    for (std::size_t i = 0; i + 1 < n; ++i) {
      const Vector3 e = w_[i] * (nominal[i + 1] - f_[i] * nominal[i]) / q_;
      b[i] += f_[i].transpose() * e;
      b[i + 1] -= e;
    }
    for (std::size_t i = 0; i + 1 < n; ++i) b[i + 1] -= eliminators_[i] * b[i];
    std::vector<Vector3> s(n);
    for (std::size_t i = n; i-- > 0;) {
      s[i] = pivots_[i].solve(b[i]);
      if (i + 1 < n) s[i] -= eliminators_[i].transpose() * s[i + 1];
    }
    double cost = 0.0;
    x.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      cost += s[i][0] * s[i][0];
      s[i] += nominal[i];
      x[i] = s[i][0];
    }
    for (std::size_t i = 0; i + 1 < n; ++i) {
      const Vector3 e = s[i + 1] - f_[i] * s[i];
      cost += e.dot(w_[i] * e) / q_;
    }
    return cost;
  }

  double log_determinant() const { return log_determinant_; }

 private:
  std::vector<Matrix3> f_, w_;
  double q_ = 1.0, log_determinant_ = 0.0;
  std::vector<Eigen::LDLT<Matrix3>> pivots_;
  std::vector<Matrix3> eliminators_;  // block (i + 1, i) times the inverse of pivot i
};

// Smooths block by block. @return [component][sample]
Samples smooth_in_blocks(const Samples& samples, const std::vector<double>& steps) {
  const std::size_t n = steps.size() + 1;
  Samples out = samples;
  for (std::size_t begin = 0; begin < n;) {
    const std::size_t end = begin + 2 * kBlock > n ? n : begin + kBlock;  // the last one takes what is left
    const std::size_t from = begin < kBlend ? 0 : begin - kBlend, to = std::min(n, end + kBlend);
    Samples part;
    for (const auto& component : samples) part.emplace_back(at(component, from), at(component, to));
    const SmoothCurve curve = smooth_curve(part, {at(steps, from), at(steps, to - 1)});
    for (std::size_t c = 0; c < samples.size(); ++c) {
      for (std::size_t i = from; i < to; ++i) {
        // Up to begin + kBlend the block before has written.
        const bool shared = begin > 0 && i < begin + kBlend;
        const double share = shared ? static_cast<double>(i - from + 1) / (2.0 * kBlend + 1.0) : 1.0;
        out[c][i] += share * (curve.values[c][i - from] - out[c][i]);
      }
    }
    begin = end;
  }
  return out;
}

}  // namespace

SmoothCurve smooth_curve(const std::vector<std::vector<double>>& samples, const std::vector<double>& steps) {
  SmoothCurve out;
  out.values = samples;
  out.log10_ratio = kRoughest;
  const std::size_t n = steps.size() + 1, k = samples.size();
  if (n < kFewest || k == 0) return out;
  std::vector<double> sorted = steps;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(n / 2), sorted.end());
  const double unit = sorted[n / 2];
  std::vector<double> times(steps.size());
  for (std::size_t i = 0; i < steps.size(); ++i) times[i] = std::clamp(steps[i] / unit, 1e-2, kLongestStep);

  Problem problem(times);
  const auto degrees = static_cast<double>(k * (n - 3));  // a parabola fits three samples
  double best = -1e300;
  // The likelihood with the noise at its own optimum, but for what does not depend on the ratio.
  const auto attempt = [&](double log10_ratio) {
    const double q = std::pow(10.0, log10_ratio);
    problem.factor(q);
    double cost = 0.0;
    std::vector<std::vector<double>> values(k);
    for (std::size_t c = 0; c < k; ++c) cost += problem.solve(samples[c], times, values[c]);
    if (!(cost > 0.0) || !std::isfinite(cost)) return;
    const double likelihood =
        -0.5 * (degrees * std::log(cost / degrees) +
                static_cast<double>(k) *
                    (problem.log_determinant() + 3.0 * static_cast<double>(n - 1) * std::log(q)));
    if (!(likelihood > best)) return;
    best = likelihood;
    out.values = std::move(values);
    out.noise = std::sqrt(cost / degrees);
    out.log10_ratio = log10_ratio;
  };
  for (double r = kSmoothest; r <= kRoughest; r += kCoarseStep) attempt(r);
  for (double step = 0.5 * kCoarseStep; step > 0.5 * kFineStep; step *= 0.5) {
    const double middle = out.log10_ratio;
    for (const double r : {middle - step, middle + step}) {
      if (r >= kSmoothest && r <= kRoughest) attempt(r);
    }
  }
  return out;
}

void smooth_trajectory(const std::vector<Submap>& submaps, std::vector<TrajectoryPose>& trajectory) {
  std::vector<TrackingState> states;
  for (const Submap& m : submaps) {
    for (const ScanPose& s : m.scans) states.push_back(s.state);
  }
  const std::size_t n = std::min(states.size(), trajectory.size());
  for (std::size_t begin = 0; begin < n;) {
    std::size_t end = begin + 1;
    while (end < n && states[end] != TrackingState::kLost) ++end;
    std::vector<double> steps;
    for (std::size_t i = begin + 1; i < end; ++i) {
      steps.push_back(1e-6 * static_cast<double>(trajectory[i].utime - trajectory[i - 1].utime));
    }
    std::vector<double> sorted = steps;
    std::sort(sorted.begin(), sorted.end());
    const double usual = sorted.empty() ? 0.0 : sorted[sorted.size() / 2];
    if (usual > kInertia_s) {
      begin = end;
      continue;
    }
    for (double& t : steps) t = t > 0.0 ? t : (usual > 0.0 ? usual : 0.1);

    Samples horizontal(2), height(1), attitude(4);
    Eigen::Quaterniond before = Eigen::Quaterniond::Identity();
    for (std::size_t i = begin; i < end; ++i) {
      const Pose& p = trajectory[i].map_from_sensor;
      horizontal[0].push_back(p.translation.x());
      horizontal[1].push_back(p.translation.y());
      height[0].push_back(p.translation.z());
      Eigen::Quaterniond q = p.rotation;
      if (q.dot(before) < 0.0) q.coeffs() = -q.coeffs();  // the same rotation, on the same side
      for (int c = 0; c < 4; ++c) attitude[static_cast<std::size_t>(c)].push_back(q.coeffs()[c]);
      before = q;
    }
    const Samples h = smooth_in_blocks(horizontal, steps), v = smooth_in_blocks(height, steps),
                  a = smooth_in_blocks(attitude, steps);
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t j = i - begin;
      const Eigen::Quaterniond q(a[3][j], a[0][j], a[1][j], a[2][j]);
      trajectory[i].map_from_sensor = Pose(q.normalized(), {h[0][j], h[1][j], v[0][j]});
    }
    begin = end;
  }
}

}  // namespace hp2
