// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "eval/probability_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace accessvdb::eval {
namespace {

constexpr int kMostSteps = 100;
constexpr double kStill = 1e-10, kRidge = 1e-6;

/// Of the terms that are kept.
Eigen::VectorXd newton(std::span<const FitSample> samples, const std::vector<std::size_t>& kept) {
  const auto count = static_cast<Eigen::Index>(kept.size());
  Eigen::VectorXd odds = Eigen::VectorXd::Zero(count), x(count);
  for (int step = 0; step < kMostSteps; ++step) {
    // The ridge keeps a term finite that is the same for all, and is far below what one sample says.
    Eigen::MatrixXd hessian = kRidge * Eigen::MatrixXd::Identity(count, count);
    Eigen::VectorXd gradient = -kRidge * odds;
    for (const FitSample& sample : samples) {
      for (Eigen::Index n = 0; n < count; ++n)
        x[n] = static_cast<double>(sample.terms[kept[static_cast<std::size_t>(n)]]);
      const double p = 1 / (1 + std::exp(-odds.dot(x)));
      gradient += sample.weight * ((sample.accessible ? 1.0 : 0.0) - p) * x;
      hessian += sample.weight * p * (1 - p) * x * x.transpose();
    }
    const Eigen::VectorXd change = hessian.ldlt().solve(gradient);
    odds += change;
    if (change.cwiseAbs().maxCoeff() < kStill) break;
  }
  return odds;
}

}  // namespace

std::array<double, kFitTerms> fitOdds(std::span<const FitSample> samples, const std::array<int, kFitTerms>& signs) {
  std::vector<std::size_t> kept;
  for (std::size_t n = 0; n < kFitTerms; ++n) {
    const auto differs = [&](const FitSample& sample) { return sample.terms[n] != samples.front().terms[n]; };
    if (n == 0 || std::any_of(samples.begin(), samples.end(), differs)) kept.push_back(n);
  }
  for (;;) {
    const Eigen::VectorXd odds = newton(samples, kept);
    std::size_t worst = kept.size();
    double most = 0;
    for (std::size_t k = 0; k < kept.size(); ++k) {
      const double wrong = -signs[kept[k]] * odds[static_cast<Eigen::Index>(k)];
      if (wrong > most) most = wrong, worst = k;
    }
    if (worst < kept.size()) {
      kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(worst));
      continue;
    }
    std::array<double, kFitTerms> constants = {};
    for (std::size_t k = 0; k < kept.size(); ++k) constants[kept[k]] = odds[static_cast<Eigen::Index>(k)];
    return constants;
  }
}

void Reliability::add(double said, bool label, bool accessible) {
  const double was = accessible ? 1 : 0;
  const auto thousandths = static_cast<std::size_t>(std::lround(1000 * said));  // 0.9 as a float is below 0.9
  Decile& decile = deciles_[std::min(thousandths / 100, kDeciles - 1)];
  ++decile.points;
  decile.accessible += accessible ? 1 : 0;
  decile.said += said;
  ++points_;
  squares_ += (said - was) * (said - was);
  label_squares_ += label == accessible ? 0 : 1;
}

double Reliability::farthestOff() const {
  double most = 0;
  for (const Decile& decile : deciles_)
    if (decile.counts()) most = std::max(most, std::abs(decile.saidPercent() - decile.wasPercent()));
  return most;
}

}  // namespace accessvdb::eval
