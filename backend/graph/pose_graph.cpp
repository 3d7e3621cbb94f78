#include "backend/graph/pose_graph.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>

#include <Eigen/Cholesky>
#include <ceres/ceres.h>

namespace hp2 {
namespace {

using Block = std::array<double, 7>;  // x y z w of the quaternion, then the translation [m]

Pose pose_of(const double* b) {
  Pose p;
  p.rotation.coeffs() = Eigen::Map<const Eigen::Vector4d>(b);
  p.translation = Eigen::Map<const Eigen::Vector3d>(b + 4);
  return p;
}

void store(const Pose& p, double* b) {
  std::copy_n(p.rotation.coeffs().data(), 4, b);
  std::copy_n(p.translation.data(), 3, b + 4);
}

// SE(3) with right increments. The cost below hands out derivatives by the increment itself in the first six
// of its seven columns, so the Jacobian of Plus() that maps those to the increment is [I; 0]: nothing is ever
// differentiated by a quaternion's coefficients.
class PoseManifold : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* y) const override {
    store(pose_of(x) * se3_exp(Eigen::Map<const Vector6d>(delta)), y);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.topRows<6>().setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* delta) const override {
    const Vector6d difference = se3_log(pose_of(x).inverse() * pose_of(y));
    std::copy_n(difference.data(), 6, delta);
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.leftCols<6>().setIdentity();
    return true;
  }
};

class EdgeCost : public ceres::SizedCostFunction<6, 7, 7> {
 public:
  explicit EdgeCost(const GraphEdge& edge) : z_(edge.from_from_to) {
    const Eigen::LLT<Matrix6d> llt(edge.information);
    root_ = llt.matrixU();
  }
  bool Evaluate(double const* const* x, double* residual, double** jacobians) const override {
    Matrix6d by_a, by_b;
    const Vector6d e = edge_error(pose_of(x[0]), pose_of(x[1]), z_, jacobians ? &by_a : nullptr,
                                  jacobians ? &by_b : nullptr);
    const Vector6d whitened = root_ * e;
    std::copy_n(whitened.data(), 6, residual);
    for (int k = 0; jacobians && k < 2; ++k) {
      if (!jacobians[k]) continue;
      Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobians[k]);
      j.leftCols<6>() = root_ * (k == 0 ? by_a : by_b);
      j.rightCols<1>().setZero();
    }
    return true;
  }

 private:
  Pose z_;
  Matrix6d root_;
};

Matrix6d small_adjoint(const Vector6d& x) {
  Matrix6d m = Matrix6d::Zero();
  m.topLeftCorner<3, 3>() = m.bottomRightCorner<3, 3>() = skew(x.tail<3>());
  m.topRightCorner<3, 3>() = skew(x.head<3>());
  return m;
}

// Inverse of the right Jacobian of SE(3) at x: sum of B_n (-ad(x))^n / n! with the sign of B_1 turned. The
// series converges for angles below 2 pi; sixteen terms leave less than 1e-5 at pi.
Matrix6d inverse_right_jacobian(const Vector6d& x) {
  constexpr double kBernoulli[] = {1.0 / 12.0,          -1.0 / 720.0,
                                   1.0 / 30240.0,       -1.0 / 1209600.0,
                                   1.0 / 47900160.0,    -691.0 / 1307674368000.0,
                                   1.0 / 74724249600.0, -3617.0 / 10670622842880000.0};
  const Matrix6d ad = small_adjoint(x);
  const Matrix6d ad2 = ad * ad;
  Matrix6d sum = Matrix6d::Identity() + 0.5 * ad;
  Matrix6d power = Matrix6d::Identity();
  const double tiny = 1e-14;
  for (const double b : kBernoulli) {
    power = power * ad2;
    sum += b * power;
    if (power.cwiseAbs().maxCoeff() < tiny) break;
  }
  return sum;
}

// Squared gap of the loops over what the odometry's covariances predict, as the median over the closures.
// Above 1 the covariances are too small. A few false closures do not move the median far.
double odometry_inflation(const std::vector<GraphEdge>& odometry, const std::vector<GraphEdge>& closures) {
  if (closures.empty()) return 1.0;
  // Covariances of the steps moved into one frame add up, so a prefix sum gives any stretch of the chain at
  // once.
  std::vector<Pose> chain(odometry.size() + 1);
  std::vector<Matrix6d> sums(odometry.size() + 1, Matrix6d::Zero());
  for (std::size_t k = 0; k < odometry.size(); ++k) {
    chain[k + 1] = chain[k] * odometry[k].from_from_to;
    const Matrix6d a = adjoint(chain[k + 1]);
    sums[k + 1] = sums[k] + a * odometry[k].information.inverse() * a.transpose();
  }
  std::vector<double> ratios;
  for (const GraphEdge& c : closures) {
    const std::size_t i = std::min(c.from, c.to), j = std::max(c.from, c.to);
    const Matrix6d a = adjoint(chain[c.to].inverse());
    const Matrix6d covariance = a * (sums[j] - sums[i]) * a.transpose() + c.information.inverse();
    const Vector6d e = edge_error(chain[c.from], chain[c.to], c.from_from_to, nullptr, nullptr);
    ratios.push_back(e.dot(covariance.ldlt().solve(e)) / 6.0);
  }
  std::nth_element(ratios.begin(), ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2),
                   ratios.end());
  return std::clamp(ratios[ratios.size() / 2], 1.0, 1e4);
}

}  // namespace

Vector6d edge_error(const Pose& a, const Pose& b, const Pose& z, Matrix6d* by_a, Matrix6d* by_b) {
  const Pose a_from_b = a.inverse() * b;
  const Vector6d e = se3_log(z.inverse() * a_from_b);
  if (by_a || by_b) {
    const Matrix6d j = inverse_right_jacobian(e);
    if (by_a) *by_a = -j * adjoint(a_from_b.inverse());
    if (by_b) *by_b = j;
  }
  return e;
}

EdgeGap edge_gap(const std::vector<Pose>& nodes, const GraphEdge& edge) {
  const Pose gap = edge.from_from_to.inverse() * nodes[edge.from].inverse() * nodes[edge.to];
  return {gap.translation.norm(), rotation_angle(gap.rotation)};
}

PoseGraphSummary optimise(std::vector<Pose>& nodes, const std::vector<GraphEdge>& odometry,
                          const std::vector<GraphEdge>& closures, double closure_scale) {
  PoseGraphSummary out;
  if (nodes.size() < 2) return out;
  std::vector<Block> blocks(nodes.size());
  PoseManifold manifold;
  ceres::CauchyLoss cauchy(std::max(closure_scale, 1e-6));
  ceres::Problem::Options options;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.disable_all_safety_checks = true;
  ceres::Problem problem(options);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    store(nodes[i], blocks[i].data());
    problem.AddParameterBlock(blocks[i].data(), 7, &manifold);
  }
  problem.SetParameterBlockConstant(blocks[0].data());
  for (const GraphEdge& e : odometry) {
    problem.AddResidualBlock(new EdgeCost(e), nullptr, blocks[e.from].data(), blocks[e.to].data());
  }
  for (const GraphEdge& e : closures) {
    problem.AddResidualBlock(new EdgeCost(e), closure_scale > 0.0 ? &cauchy : nullptr, blocks[e.from].data(),
                             blocks[e.to].data());
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = 50;
  solver.function_tolerance = 1e-5;
  solver.num_threads = 1;  // the sums' order, and so the result, must not depend on the machine
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  out = {summary.initial_cost, summary.final_cost, static_cast<int>(summary.iterations.size()),
         summary.termination_type == ceres::CONVERGENCE};
  if (!summary.IsSolutionUsable()) return out;
  for (std::size_t i = 1; i < nodes.size(); ++i) {
    const Pose p = pose_of(blocks[i].data());
    nodes[i] = Pose(p.rotation, p.translation);
  }
  return out;
}

std::vector<bool> optimise_consistent(std::vector<Pose>& nodes, const std::vector<GraphEdge>& odometry,
                                      const std::vector<GraphEdge>& closures, const EdgeGap& max_gap) {
  constexpr int kMaxRounds = 8;
  std::vector<GraphEdge> loosened = odometry;
  const double inflation = odometry_inflation(odometry, closures);
  for (GraphEdge& e : loosened) e.information /= inflation;
  const auto badness = [&](const GraphEdge& c) {
    const EdgeGap gap = edge_gap(nodes, c);
    return std::max(gap.translation_m / max_gap.translation_m, gap.rotation_rad / max_gap.rotation_rad);
  };
  std::vector<bool> used(closures.size(), true);
  for (int round = 0; round < kMaxRounds; ++round) {
    std::vector<GraphEdge> taken;
    for (std::size_t i = 0; i < closures.size(); ++i) {
      if (used[i]) taken.push_back(closures[i]);
    }
    optimise(nodes, loosened, taken);
    // The worst go first: once they are out, others that they pulled away from the truth may agree again.
    double worst = 1.0;
    for (std::size_t i = 0; i < closures.size(); ++i) {
      if (used[i]) worst = std::max(worst, badness(closures[i]));
    }
    bool changed = false;
    for (std::size_t i = 0; i < closures.size(); ++i) {
      const double b = badness(closures[i]);
      if (used[i] ? (b > 1.0 && b >= 0.5 * worst) : b < 0.5) {
        used[i] = !used[i];
        changed = true;
      }
    }
    if (!changed) break;
  }
  return used;
}

}  // namespace hp2
